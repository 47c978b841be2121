"""The verdict on a bed: its number, its bound, its error, the same in every output."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import thirdbody
from thirdbody.granular_flow import friction_increase, inertia_verdict
from thirdbody.plot.summary_page import page
from thirdbody.report.tables import run_report
from thirdbody.trajectory.bed_verdict import bed_warning, softness_verdict, steady
from thirdbody.trajectory.names import BED

from ..layer import write_layer

FRAMES = 41


@pytest.fixture
def folder(tmp_path) -> Path:
    """A finished run of a bed whose inertial number is 0.5 in the first half and scatters about 0.02 in the second."""
    path = write_layer(tmp_path / "run.vtkhdf", 3, FRAMES)
    number = np.where(np.arange(FRAMES) <= FRAMES // 2, 0.5, 0.02 + 0.002 * np.resize([1.0, -1.0], FRAMES))
    values = dict.fromkeys(BED, np.full(FRAMES, 0.5)) | {
        "inertial_number": number,
        "inertial_number_largest": 1.5 * number,
        "softness": np.full(FRAMES, 1.2e4),
    }
    with h5py.File(path, "r+") as file:
        for name, row in values.items():
            file["series"].create_dataset(name, data=row).attrs["units"] = "1"
        summary = {"finished": True, "wall_time": 1.0, "steps": 10, "sphere_steps_per_second": 1.0, "energy_residual": 1e-6}
        file["scene"].create_dataset("summary", data=np.bytes_(json.dumps(summary))).attrs["json"] = np.uint8(1)
    return tmp_path


def test_every_output_has_the_mean_over_the_steady_part(folder, capsys):
    with thirdbody.open(folder) as run:
        bed, summary = run.bed, run.summary()
        mean = run.series["inertial_number"][FRAMES // 2 + 1 :].mean()
        assert bed.means["inertial_number"] == summary["inertial_number"] == pytest.approx(mean, rel=1e-12)
        # values that alternate count as independent: 0.002 / sqrt(20), and the factor for the estimated mean
        assert 0.002 / 20**0.5 < bed.errors["inertial_number"] < 0.0007
        assert summary["quasi_static"] is False and bed.verdict == summary["bed_verdict"] == inertia_verdict(mean)
        assert "solver.inertial_number = 0.001" in bed_warning(bed)
        titles = [axes.get_title(loc="left") for axes in page(run, ["bed"]).axes]
        assert titles == [f"Bed: {bed.verdict}"]
    run_report(folder, json=False)
    printed = capsys.readouterr()
    assert bed.verdict in printed.out and "stiff: kappa = 12000" in printed.out
    assert "the bed is not quasi-static" in printed.err
    run_report(folder, json=True)
    assert json.loads(capsys.readouterr().out)["bed_verdict"] == bed.verdict


def test_a_run_without_these_series_has_no_bed(tmp_path):
    with thirdbody.open(write_layer(tmp_path / "run.vtkhdf", 3, 4)) as run:
        assert run.bed is None and "bed_verdict" not in run.summary()


@pytest.mark.parametrize(
    "drag, first, last",
    [
        ({"dragged": False}, 20, 40),
        ({"dragged": True, "stroke": False, "second_half": np.arange(FRAMES) > 24}, 25, 40),
        # four cycles, then part of a fifth: the last two whole ones, without the frame at which the third begins
        ({"dragged": True, "stroke": True, "cycles": [slice(k, k + 9) for k in (0, 8, 16, 24)]}, 17, 32),
        ({"dragged": True, "stroke": True, "cycles": [], "second_half": np.arange(FRAMES) > 30}, 31, 40),
    ],
)
def test_the_steady_part(drag, first, last):
    run = SimpleNamespace(frames=FRAMES, series={"friction_coefficient": np.full(FRAMES, 0.3)}, drag=SimpleNamespace(**drag))
    assert np.flatnonzero(steady(run)).tolist() == list(range(first, last + 1))


@pytest.mark.parametrize(
    "number, words",
    [
        (8e-4, "quasi-static: I = 0.0008, friction within 0.0007 of its slow limit"),
        (1e-6, "quasi-static: I = 0.000001, friction within 0.0001 of its slow limit"),
        (4e-3, "nearly quasi-static: I = 0.004 raises friction by about 0.004"),
        (0.02, "not quasi-static: I = 0.02 raises friction by about 0.02"),
    ],
)
def test_the_verdict_gives_the_number_and_what_it_means(number, words):
    assert inertia_verdict(number) == words


def test_the_rise_is_that_of_the_published_law():
    # Jop et al.: mu_s = tan 20.9, mu_2 = tan 32.76, I_0 = 0.279
    low, high, scale = np.tan(np.radians(20.9)), np.tan(np.radians(32.76)), 0.279
    for number in (1e-3, 1e-2, 0.1, 1.0):
        assert friction_increase(number) == pytest.approx(
            (high - low) / (scale / number + 1.0), rel=0.01
        )  # two digits are printed


@pytest.mark.parametrize("softness, word", [(1.2e4, "stiff: kappa = 12000"), (2e3, "fairly stiff"), (500.0, "soft: kappa = 500")])
def test_the_verdict_on_softness(softness, word):
    assert softness_verdict(softness, 1e-4).startswith(word) and "0.01 % of the radius" in softness_verdict(softness, 1e-4)
