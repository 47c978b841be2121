"""Sweeps: one scene at many points, on any executor; a failed point is a row of the table.

A sweep file or the arguments of `sweep` are a `sweep_file.SweepFile`; `design` turns its axes into settings, `plan` checks these
as a scene is checked and makes a `point.Point` of each: the resolved scene, and a folder named by the hash of that scene and of
this version. `run_point.run_point(point, stop)` runs one point and returns its `point.PointResult`: it can be pickled, resumes
the point's own checkpoint, returns at once what is computed already, and never raises for a point that fails.
`driver.run_points(points, executor, record, stop)` hands the points to any executor with the `submit` of `concurrent.futures`
(`local_workers.LocalWorkers`, a Dask client's `get_executor()`) and calls `record` for each result in its own thread.
`table` keeps `points.csv`, `reader.Sweep` reads it.
"""
