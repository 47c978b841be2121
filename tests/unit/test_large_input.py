"""What is too large is told by its headers or counts, before it takes memory or time."""

import numpy as np
import pytest
from steel import STEEL

from thirdbody import units
from thirdbody.assembly.csv_series import rows_of
from thirdbody.bodies.clumps_from_table import load_bodies
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene

TAIL = """
[domain]\nsize = ["80 um", "60 um"]\n[plates.lower]\nmaterial = "steel"
[solver]\nduration = "2 us"\n[output]\nevery = "0.5 us"\n"""
BALL = '[[debris]]\nkind = "spheres"\nmaterial = "steel"\nradius = "1 um"\ncount = 1\n'


def test_an_npz_of_too_many_spheres_is_refused(tmp_path):
    n = 1_000_001
    np.savez_compressed(tmp_path / "b.npz", center=np.zeros((n, 3)), radius=np.zeros(n), clump=np.zeros(n, int))
    with pytest.raises(InputError, match="center: has 1000001 rows, at most 1000000 spheres are read from one file"):
        load_bodies(tmp_path / "b.npz", units.parse)


def test_tables_of_too_many_rows_are_refused_before_they_are_split(tmp_path):
    (tmp_path / "b.csv").write_bytes(b"clump,x [um],y [um],z [um],radius [um]\n" + b"1,1,1,1,1\n" * 1_000_001)
    with pytest.raises(InputError, match="b.csv: has 1000001 rows, at most 1000000 spheres are read from one file"):
        load_bodies(tmp_path / "b.csv", units.parse)
    (tmp_path / "m.csv").write_bytes(b"time (us), displacement (um)\n" + b"1,1\n" * 1_000_000)
    scene = Scene.parse(STEEL + BALL + TAIL, folder=tmp_path)
    with pytest.raises(InputError, match="is too large: at most 1000000 rows and 100 MB are read"):
        rows_of(scene, ("plates", "upper", "motion", "x", "table"), "m.csv", "displacement", "length")


def test_values_that_are_wrong_by_the_thousand_are_counted(tmp_path):
    n = 5000
    np.savez(tmp_path / "b.npz", center=np.full((n, 3), np.nan), radius=np.zeros(n), clump=np.zeros(n, int))
    with pytest.raises(InputError) as report:
        load_bodies(tmp_path / "b.npz", units.parse)
    assert len(report.value.faults) == 11 and report.value.faults[-1].message == "and 19990 more faults"


def test_a_scene_of_too_many_tables_is_reported_by_their_number_alone():
    for head, debris, message in (
        (STEEL + "".join(f"[materials.m{k}]\n" for k in range(1000)), BALL, "materials: 1001 materials, at most 1000 are read"),
        (STEEL, BALL * 1001, "debris: 1001 debris tables, at most 1000 are read"),
    ):
        with pytest.raises(InputError) as report:
            Scene.parse(head + debris + TAIL)
        assert len(report.value.faults) == 1 and message in str(report.value)
    assert len(Scene.parse(STEEL + BALL * 1000 + TAIL).debris) == 1000
