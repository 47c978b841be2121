"""A thousand random clumps: the forecast when the drag starts against what each of them then did. Marked slow: minutes.

Called as a program it draws them: `python tests/scenes/test_forecast_table.py -o scenes/balance/forecast.png`.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import thirdbody
from thirdbody.plot.forecast_plot import check_format, draw_forecasts, pool
from thirdbody.report.forecast_check import WATCHED, compare_forecast, forecasts

SCENE = """
scene = 1
title = "one friction coefficient of the forecast table"
[materials.steel]
youngs_modulus = "210 GPa"
poisson_ratio = 0.30
density = "7850 kg/m3"
[[pairs]]
between = ["steel", "steel"]
friction = {friction}
restitution = 0.60
[[debris]]
material = "steel"
kind = "irregular"
count = {count}
seed = {seed}
size = {{distribution = "lognormal", median = "10 um", sigma = 0.2, min = "6 um", max = "16 um"}}
spheres = [3, 8]
aspect = [1.0, 0.8, 0.6]
placement = "layer"
[domain]
size = ["260 um", "260 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
motion = {{x = {{velocity = "0.1 m/s"}}}}
[contact]
debris_contact = "none"
[solver]
integrator = "{integrator}"
distance = "7 um"
[output]
every = "0.1 um"
"""

FRICTIONS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)


def runs(folder: Path, integrator: str) -> Iterator[tuple[float, thirdbody.Run]]:
    """Friction coefficient and run of a hundred clumps, one after the other."""
    for k, friction in enumerate(FRICTIONS):
        scene = thirdbody.Scene.parse(SCENE.format(friction=friction, count=100, seed=k + 1, integrator=integrator))
        with thirdbody.run(scene, out=folder / f"{k}", progress=False) as run:
            yield friction, run


BAND = 0.02
"""Relative distance of mu from t_min and t_max within which the answer is open."""


def doubtful(bodies: dict[str, np.ndarray], friction: float) -> np.ndarray:
    """Bodies whose friction lies within the band around an end of their sliding interval."""
    near = np.zeros(len(bodies["t_min"]), bool)
    for end in ("t_min", "t_max"):
        near |= np.abs(bodies[end] - friction) <= BAND * friction
    return near


def changes(run: thirdbody.Run, start: int) -> np.ndarray:
    """Changes of label of every body between the frames of the drag."""
    return np.count_nonzero(np.diff(run.states[start + 1 :].astype(int), axis=0), axis=0)


@pytest.fixture(scope="module", params=["explicit", "implicit"])
def table(request, tmp_path_factory):
    """Rows: friction, bodies with a forecast outside the band, those that agree, label changes per body."""
    rows = []
    for friction, run in runs(tmp_path_factory.mktemp("forecast"), request.param):
        found = compare_forecast(run)
        bodies = run.bodies(found["frame"])
        clear = ~doubtful(bodies, friction)
        wrong = [b for name in ("rolls_instead", "slides_instead") for b in found[name] if clear[b]]
        report = int(np.count_nonzero(clear & (run.forecast[found["frame"]] != 4)))
        row = {"friction": friction, "forecast": report, "agree": report - len(wrong), "wrong": wrong}
        rows.append(row | {"changes": float(changes(run, found["frame"]).mean())})
        rows[-1] |= {"slides": len(found["slides_as_forecast"]), "residual": run.summary()["energy_residual"]}
        drawn = forecasts(run)  # the picture counts as the table does
        rows[-1]["drawn"] = (int(drawn.clear.sum()), drawn.body[drawn.clear & ~drawn.correct].tolist())
        print(json.dumps(rows[-1]))
    return rows


@pytest.mark.full(kind="slow")
def test_forecast_and_fact_agree(table):
    report, agree = sum(row["forecast"] for row in table), sum(row["agree"] for row in table)
    assert report > 900
    assert agree >= 0.98 * report, f"{agree} of {report}"
    # both answers occur
    assert 50 < sum(row["slides"] for row in table) < report - 50


@pytest.mark.full(kind="slow")
def test_labels_do_not_flicker(table):
    assert np.mean([row["changes"] for row in table]) < 3.0


@pytest.mark.full(kind="slow")
def test_the_ledgers_close(table):
    assert max(row["residual"] for row in table) < 1e-3
    assert WATCHED == 40.0


@pytest.mark.full(kind="slow")
def test_the_picture_shows_what_the_table_counts(table):
    for row in table:
        report, wrong = row["drawn"]
        assert (report, wrong) == (row["forecast"], sorted(row["wrong"]))


def main() -> None:
    """Draw the bodies of all runs in one picture."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="picture: .png, .pdf or .svg")
    out = parser.parse_args().out
    check_format(out)  # before the minutes of runs
    with tempfile.TemporaryDirectory() as folder:
        everything = pool([forecasts(run) for _, run in runs(Path(folder), "explicit")])
    draw_forecasts(everything, out, "A thousand random clumps: forecast against fact")


if __name__ == "__main__":
    main()
