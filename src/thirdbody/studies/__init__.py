"""Studies: many runs of one scene, compared: sweeps, accuracy against time, effects.

A `point.Point` is a scene and a folder; `point.run_point(point, stop)` runs it and returns its `PointResult`: it can be pickled,
resumes the point's own checkpoint, returns at once what is computed already, and never raises for a point that fails.
`runner.run_points` hands points to any executor with the `submit` of `concurrent.futures` (`workers.LocalWorkers`, those of Dask
through `workers.DaskPoints`); `folder.Table` keeps `points.csv`. A sweep makes points from axes (`sweep_file`, `axes`, `plan`;
`folder.SweepTable` reads them), a study of cost from variants of a smaller copy (`copies`, `variants`, `cost_runs`, `cost`).
"""
