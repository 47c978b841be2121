"""Several contacts of a sphere with one plate: between ribs (`ribbed_surface`) it touches the crests of two.

First bodies are compiled into the engine, so the runs are those of a copy of the package with another `kernels.surface`, in a
process of its own (`ribbed_runs`), which compiles all of it: a minute.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ribbed_runs import COS, LOAD, MU, SIN

import thirdbody

pytestmark = pytest.mark.slow

BODIES, SPHERES, WALLS = 2, 2, 2
TESTS, PACKAGE = Path(__file__).parents[1], Path(thirdbody.__file__).parent


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> dict:
    folder = tmp_path_factory.mktemp("ribs")
    copy = folder / "package" / "thirdbody"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copyfile(TESTS / "ribbed_surface.py", copy / "kernels" / "surface.py")
    first = os.pathsep.join(str(path) for path in (copy.parent, TESTS))
    done = subprocess.run(
        [sys.executable, TESTS / "ribbed_runs.py", folder / "runs"], env=os.environ | {"PYTHONPATH": first}, cwd=folder,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(params=["explicit", "implicit"])
def run(report, request) -> dict:
    return report[request.param]


def forces(contacts: list[dict]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals, normal forces and tangential forces."""
    return tuple(np.array([one[name] for one in contacts]) for name in ("normal", "normal_force", "tangential_force"))


@pytest.mark.parametrize("when", ["rest", "pulled"])
def test_a_sphere_in_a_groove_has_two_contacts_with_one_plate(run, when):
    contacts = run["rest"]["contacts"] if when == "rest" else run["contacts"]
    keys = [(one["body"], one["sphere"], one["partner"]) for one in contacts]
    assert sorted(keys) == [(b, s, -1 - basin) for b in range(BODIES) for s in range(SPHERES) for basin in (1, 0)]
    leans = {key: np.sign(one["normal"][0]) for key, one in zip(keys, contacts, strict=True)}
    # the ribs are those with the numbers 0, 1 and 1, 2, modulo 2: in the second groove the left one has the higher number
    assert all(sign == (1 if b == -1 - partner else -1) for (b, _, partner), sign in leans.items())


def test_at_rest_forces_are_those_of_a_wedge_that_just_slipped_in(run):
    """Pressed in, both contacts slip down the walls: W/2 = N (cos + mu sin) each, and friction points up the walls.

    What still swings when settling ends, some 1e-3 of the load, has taken up to 4e-3 of the friction back.
    """
    normals, N, T = forces(run["rest"]["contacts"])
    # the angle changes by overlap over radius, 2e-3
    assert pytest.approx(LOAD / (SPHERES * WALLS) / (COS + MU * SIN), rel=3e-3) == N
    assert normals[:, 2] == pytest.approx(COS, rel=2e-3)
    assert N * normals[:, 2] + T[:, 2] == pytest.approx(LOAD / (SPHERES * WALLS), rel=1e-3)
    up = np.column_stack([-np.sign(normals[:, 0]) * normals[:, 2], 0.0 * N, np.abs(normals[:, 0])])
    friction = np.sum(up * T, axis=1)
    assert np.all(friction > 0.99 * MU * N) and np.all(friction < (1.0 + 1e-9) * MU * N)
    assert run["rest"]["labels"] == ["sticking"] * BODIES


def test_pulled_along_its_groove_each_contact_carries_its_friction(run):
    """The friction of the walls no longer points up: W/2 = N cos, together a coefficient of mu / cos."""
    normals, N, T = forces(run["contacts"])
    # the speed is steady to 1e-4; N and T are those of one instant
    assert float(N @ normals[:, 2]) == pytest.approx(BODIES * LOAD, rel=1e-3)
    assert T[:, 1] == pytest.approx(-MU * N, rel=1e-4)
    assert np.abs(T[:, [0, 2]]).max() < 1e-4 * MU * N.min()
    steepness = float(N.sum() / (N @ normals[:, 2]))
    assert run["friction"] == pytest.approx(MU * steepness, rel=1e-4)
    assert run["friction"] == pytest.approx(MU / COS, rel=2e-3), "the angle changes by overlap over radius"
    assert run["labels"] == ["sliding"] * BODIES


def test_each_contact_has_its_own_history(run):
    """Friction of the two walls points apart at rest, so histories that were mixed up would show; a search carries each over."""
    _, _, T = forces(run["rest"]["contacts"])
    pairs = T.reshape(BODIES * SPHERES, WALLS, 3)
    assert np.all(pairs[:, 0, 0] * pairs[:, 1, 0] < 0.0)
    assert run["carried"] and run["keys"] == BODIES * SPHERES * (WALLS + 1)
    # the slip of the drag, but for its elastic part at the start and the rocking of the body
    assert [one["slip"] for one in run["contacts"]] == pytest.approx([1e-6] * len(run["contacts"]), rel=0.02)


def test_the_file_names_plates_as_it_does_without_basins(run):
    partners = run["file"]["partner"]
    assert partners.count(-1) == BODIES * SPHERES * WALLS and partners.count(-2) == BODIES * SPHERES
    assert run["file"]["contacts"] == [SPHERES * (WALLS + 1)] * BODIES


def test_energies_balance(run):
    # truncation error of velocity Verlet at a fifth of the stable step; the implicit integrator books what it loses
    assert run["residual"] < 1e-4


def test_both_integrators_agree(report):
    """Contact by contact at the end of the drag; the explicit one still has elastic waves of some 1e-5 of the load."""
    (one, N, T), (other, M, S) = (forces(report[name]["contacts"]) for name in ("explicit", "implicit"))
    assert one == pytest.approx(other, abs=1e-5)
    assert pytest.approx(M, rel=1e-3) == N
    assert pytest.approx(S, abs=1e-3 * MU * N.max()) == T
    assert report["explicit"]["friction"] == pytest.approx(report["implicit"]["friction"], rel=1e-4)


def test_a_resumed_run_has_the_bits_of_the_whole_run(run):
    assert run["differ"] == []


def test_the_search_misses_no_contact(report):
    """10 000 random spheres against every rib; then balls that hop over the ribs, at 200 instants with searches between them."""
    listed, thrown = report["listed"], report["thrown"]
    assert listed["missed"] == 0 and listed["vain"] == 0
    assert listed["found"] > 5000 and listed["double"] > 1000
    assert thrown["wrong"] == 0 and thrown["codes"] == [-2, -1] and thrown["double"] > 0
    assert thrown["searches"] > 100 and thrown["path"] > 40e-6, "balls cross several ribs"
