"""A thousand random clumps: the forecast when the drag starts against what each of them then did. Marked slow: minutes.

Called as a program it draws them: `python tests/scenes/test_forecast_table.py -o scenes/balance/forecast.png`."""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from shared_runs import PATH, PLATES, clumps
import thirdbody
from thirdbody.plot.forecast_plot import Forecasts, check_format, draw_forecasts
from thirdbody.report.forecast import WATCHED, compare_forecast, forecasts

CHANGES = {
    "debris.0.size.min": "6 um", "debris.0.size.max": "16 um", "debris.0.spheres": [3, 8], "solver.distance": "7 um",
    "output.every": "0.1 um", "contact.debris_contact": "none", "plates.upper.motion.x.velocity": "0.1 m/s",
}  # fmt: skip
FRICTIONS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)


def runs(folder, integrator):
    for k, friction in enumerate(FRICTIONS):
        own = {"pairs.0.friction": friction, "debris.0.seed": k + 1, "solver.integrator": integrator}
        scene = thirdbody.Scene.parse(clumps(100, '["260 um", "260 um"]') + PLATES + PATH).with_settings(CHANGES | own)
        with thirdbody.run(scene, out=folder / f"{k}", progress=False) as run:
            yield friction, run


BAND = 0.02  # relative distance of mu from t_min and t_max within which the answer is open


def changes(run, start):
    return np.count_nonzero(np.diff(run.states[start + 1 :].astype(int), axis=0), axis=0)


pytestmark = pytest.mark.full(kind="slow")


@pytest.fixture(scope="module", params=["explicit", "implicit"])
def table(request, tmp_path_factory):
    """Rows: friction, bodies with a forecast outside the band, those that agree, label changes per body."""
    rows = []
    for friction, run in runs(tmp_path_factory.mktemp("forecast"), request.param):
        found = compare_forecast(run)
        bodies = run.bodies(found["frame"])
        clear = ~np.any([np.abs(bodies[end] - friction) <= BAND * friction for end in ("t_min", "t_max")], axis=0)
        wrong = [b for name in ("rolls_instead", "slides_instead") for b in found[name] if clear[b]]
        report = int(np.count_nonzero(clear & (run.forecast[found["frame"]] != 4)))
        row = {"friction": friction, "forecast": report, "agree": report - len(wrong), "wrong": wrong}
        rows.append(row | {"changes": float(changes(run, found["frame"]).mean())})
        rows[-1] |= {"slides": len(found["slides_as_forecast"]), "residual": run.summary()["energy_residual"]}
        drawn = forecasts(run)  # the picture counts as the table does
        rows[-1]["drawn"] = (int(drawn.clear.sum()), drawn.body[drawn.clear & ~drawn.correct].tolist())
        print(json.dumps(rows[-1]))
    return rows


def test_forecast_and_fact_agree(table):
    report, agree = sum(row["forecast"] for row in table), sum(row["agree"] for row in table)
    assert report > 900
    assert agree >= 0.98 * report, f"{agree} of {report}"
    # both answers occur
    assert 50 < sum(row["slides"] for row in table) < report - 50
    assert np.mean([row["changes"] for row in table]) < 3.0, "labels flicker"
    assert max(row["residual"] for row in table) < 1e-3 and WATCHED == 40.0
    for row in table:  # the picture shows what the table counts
        assert row["drawn"] == (row["forecast"], sorted(row["wrong"]))


def main():
    """Draw the bodies of all runs in one picture."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="picture: .png, .pdf or .svg")
    out = parser.parse_args().out
    check_format(out)  # before the minutes of runs
    with tempfile.TemporaryDirectory() as folder:
        parts = [forecasts(run) for _, run in runs(Path(folder), "explicit")]
        everything = Forecasts(*map(np.concatenate, zip(*parts, strict=True)))
    draw_forecasts(everything, out, "A thousand random clumps: forecast against fact")


if __name__ == "__main__":
    main()
