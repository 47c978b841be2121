"""A run that was put away and taken up again is bit for bit the run that was never stopped, in every shipped scene."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from steel import STEEL
from trajectories import contents

import thirdbody
from thirdbody.errors import InputError, Interrupted
from thirdbody.kernels.columns import body_extra
from thirdbody.runner.checkpoint import FILE, read_checkpoint
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.run_loop import WallTimes
from thirdbody.runner.simulate import execute, prepare

SCENES = Path(__file__).parents[2] / "scenes"
ALONE = {"contact.debris_contact": "none"}
CASES: dict[str, tuple[str, dict[str, str]]] = {
    "sheared_debris": ("sheared_debris", {"debris.0.count": "30", "solver.distance": "0.5 um", "output.every": "0.1 um"}),
    "sheared_debris implicit": (
        "sheared_debris", ALONE | {"debris.0.count": "600", "solver.distance": "2 um", "output.every": "1 um"},
    ),
    "roller_bearing": ("roller_bearing", {"solver.distance": "0.2 um", "output.every": "0.1 um"}),
    "sliding_flakes": ("sliding_flakes", {"debris.0.count": "4", "solver.distance": "0.2 um", "output.every": "0.1 um"}),
    "sliding_flakes mdr": (
        "sliding_flakes", ALONE | {"contact.level": "mdr", "solver.distance": "0.2 um", "output.every": "0.1 um"},
    ),
    "three_spot": ("three_spot", {"solver.integrator": "explicit", "solver.distance": "2 nm", "output.every": "1 nm"}),
    "three_spot implicit": ("three_spot", {}),
    "scanned_debris": ("scanned_debris", {"debris.0.count": "8", "solver.distance": "0.1 um", "output.every": "0.05 um"}),
    "mixed_population": ("mixed_population", {"solver.distance": "0.1 um", "output.every": "0.05 um"}),
    "mixed_population rigid": (
        "mixed_population", ALONE | {"solver.distance": "0.5 um", "output.every": "0.1 um", "solver.integrator": "implicit"},
    ),
    "dense_layer": (
        "dense_layer",
        {
            "debris.0.count": "80", "domain.size": ["40 um", "40 um"], "solver.distance": "1 um", "output.every": "0.5 um",
            "solver.inertial_number": "0.02", "output.profiles": 10,
        },
    ),
    "fretting": ("fretting", {"solver.duration": "0.5 us", "output.every": "0.1 us"}),
    "sticky_submicron": (
        "sticky_submicron",
        {"debris.0.count": "48", "domain.size": ["1.3 um", "1.1 um"], "solver.distance": "30 nm", "output.every": "10 nm"},
    ),
    "yielding_debris": ("yielding_debris", {"debris.0.count": "100", "solver.distance": "2 um", "output.every": "0.5 um"}),
    "yielding_debris explicit": (
        "yielding_debris",
        {"debris.0.count": "20", "solver.distance": "0.2 um", "output.every": "0.1 um", "solver.integrator": "explicit"},
    ),
    "pivoting": (
        "sheared_debris",
        {"debris.0.count": "100", "solver.distance": "0.2 um", "output.every": "0.1 um", "effects.pivoting": {"damping": 0.3}},
    ),
    "pivoting implicit": (
        "sheared_debris",
        ALONE | {"debris.0.count": "100", "solver.distance": "2 um", "output.every": "0.5 um", "effects.pivoting": {}},
    ),
    "close_spots": (
        "sheared_debris",
        {"debris.0.count": "600", "solver.distance": "0.2 um", "output.every": "0.1 um", "effects.close_spots": {}},
    ),
    "close_spots implicit": (
        "sheared_debris",
        ALONE | {"debris.0.count": "600", "solver.distance": "2 um", "output.every": "1 um", "effects.close_spots": {}},
    ),
    "fretting_rig": ("fretting_rig", {"debris.0.count": "600", "solver.duration": "2 ms", "output.every": "1 ms"}),
}  # fmt: skip


def scene_of(name: str) -> thirdbody.Scene:
    file, settings = CASES[name]
    return thirdbody.Scene.load(SCENES / f"{file}.toml").with_settings(settings)


def after(watches: int):
    """Says stop from the so-manieth question on."""
    counter = itertools.count(1)
    return lambda: next(counter) >= watches


def cut(name: str, folder: Path, watches: int) -> bool:
    """Start the scene and stop it after so many looks; whether it was stopped before its end."""
    try:
        execute(prepare(scene_of(name)), folder, stop=after(watches))
    except Interrupted:
        return True
    return False


LONG = {"pivoting", "pivoting implicit", "yielding_debris", "yielding_debris explicit", "close_spots", "close_spots implicit"}
"""Cases that compile kernels of their own."""


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.full(kind="slow")] * (name in LONG)) for name in CASES])
def test_a_run_in_pieces_is_the_whole_run(tmp_path, name):
    reference = prepare(scene_of(name))
    execute(reference, tmp_path / "whole")
    assert_plate_followed_schedule(reference.state)
    stopped = cut(name, tmp_path / "cut", 3)
    pieces = 0
    while stopped:
        pieces += 1
        simulation, kept = prepare_resume(tmp_path / "cut")
        stopped = False
        try:
            # each piece on another number of cores, and four times as long as the one before
            execute(simulation, tmp_path / "cut", threads=1 + pieces % 2, checkpoint=kept, stop=after(2 * 4**pieces))
        except Interrupted:
            stopped = True
    assert pieces > 0, "the scene is too short to be stopped"
    whole, joined = contents(tmp_path / "whole"), contents(tmp_path / "cut")
    if name == "sticky_submicron":
        necks = reference.state.slots.records.contact_radius > 0.0
        assert necks.sum() > 20 and reference.state.E[:, body_extra.NORMAL_LOSS].sum() > 0.0
    bed = {"series/inertial_number", "series/accommodation_shear", "profiles/contact_stress"}
    assert whole.keys() == joined.keys() and (bed <= whole.keys() or name != "dense_layer")
    assert [key for key in whole if whole[key] != joined[key]] == []
    assert simulation.state.patches.displacement.tobytes() == reference.state.patches.displacement.tobytes()


def test_a_run_stopped_between_two_strides_is_the_whole_run(tmp_path):
    """Bodies that meet are searched once a stride: one that is done is not begun again."""
    execute(prepare(scene_of("close_spots")), tmp_path / "whole")
    simulation, ends = prepare(scene_of("close_spots")), itertools.count()
    with pytest.raises(Interrupted):  # `earlier` is empty where a stride is done
        execute(simulation, tmp_path / "cut", stop=lambda: not simulation.integrator.earlier and next(ends) >= 3)
    thirdbody.resume(tmp_path / "cut", progress=False).close()
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")


def assert_plate_followed_schedule(state):
    """The displacement of every patch is the integral of the plate's velocity."""
    schedule = state.world.upper.schedule
    moved = np.subtract(schedule.displacement_at(state.time), schedule.displacement_at(0.0))
    assert state.distance > 0.0
    # a sum over steps: rounding errors of up to 1e5 of them
    assert state.patches.displacement == pytest.approx(np.tile(moved, (len(state.P), 1)), rel=1e-9, abs=1e-9 * state.distance)


@pytest.mark.parametrize("name", ["sheared_debris", "sheared_debris implicit"])
def test_a_finished_run_goes_further(tmp_path, name):
    file, settings = CASES[name]
    whole = thirdbody.Scene.load(SCENES / f"{file}.toml").with_settings(settings)
    half = whole.with_settings({"solver.distance": f"{0.5e6 * whole.solver.distance} um"})
    every = {"output.every": f"{0.25e6 * whole.solver.distance} um"}
    thirdbody.run(whole.with_settings(every), tmp_path / "whole", progress=False)
    thirdbody.run(half.with_settings(every), tmp_path / "half", progress=False)
    thirdbody.resume(tmp_path / "half", progress=False, settings={"solver.distance": f"{1e6 * whole.solver.distance} um"})
    first, second = contents(tmp_path / "whole"), contents(tmp_path / "half")
    assert [key for key in first if first[key] != second[key]] == []
    with thirdbody.open(tmp_path / "half") as run:
        assert run.scene_text == whole.with_settings(every).to_toml()


@pytest.fixture(scope="module")
def stopped(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("resume") / "cut"
    assert cut("sheared_debris", folder, 3)
    return folder


@pytest.fixture()
def copy(stopped, tmp_path) -> Path:
    import shutil

    return Path(shutil.copytree(stopped, tmp_path / "run"))


def test_a_changed_scene_is_refused_with_the_difference(copy):
    with pytest.raises(InputError, match=r"pairs\[0\].friction: was 0.3, is 0.4"):
        prepare_resume(copy, {"pairs.0.friction": "0.4"})
    text = (copy / "scene.toml").read_text()
    (copy / "scene.toml").write_text(text.replace('level = "mindlin"', 'level = "mdr"'))
    with pytest.raises(InputError, match="contact.level: was mindlin, is mdr"):
        prepare_resume(copy)


def test_another_law_of_the_same_name_is_refused(tmp_path):
    """A plug-in that was edited between the two: its source is part of what the run was built from."""
    source = (SCENES.parent / "plugins" / "dmt_adhesion.py").read_text()
    plugin = tmp_path / "dmt_adhesion.py"
    plugin.write_text(source)
    scene = scene_of("sheared_debris").with_settings({"effects.dmt_adhesion.work_of_adhesion": "50 mJ/m2"})
    with pytest.raises(Interrupted):
        execute(prepare(scene, [plugin]), tmp_path / "run", stop=after(2))
    prepare_resume(tmp_path / "run", plugins=[plugin])
    other = tmp_path / "other" / "dmt_adhesion.py"
    other.parent.mkdir()
    other.write_text(source + "\nMORE = 1.0\n")
    with pytest.raises(InputError, match="the contact laws: was .*dmt_adhesion"):
        prepare_resume(tmp_path / "run", plugins=[other])


def test_a_limit_of_wall_time_leaves_a_checkpoint(tmp_path):
    with pytest.raises(Interrupted, match=r"limit of wall time.*thirdbody\.resume\("):
        execute(prepare(scene_of("sheared_debris")), tmp_path / "run", times=WallTimes(limit=0.0))
    thirdbody.resume(tmp_path / "run", progress=False).close()


def test_resume_reads_what_it_wrote_though_the_interrupted_run_is_still_open(tmp_path):
    """As in a notebook: Ctrl-C, a look at what is there, resume. Only the checkpoint at the start was written by then."""

    def report(progress):
        if progress.frame == 2:
            raise KeyboardInterrupt

    scene, folder = scene_of("sliding_flakes"), tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        execute(prepare(scene), folder, 1, report)
    with thirdbody.open(folder) as old:
        assert (old.frames, old.summary()["finished"]) == (2, False)
        with thirdbody.resume(folder, threads=1, progress=False) as new:
            assert new.frames > 2 and new.summary()["finished"]
            assert new.series["time"][:2].tolist() == old.series["time"].tolist()
        assert (old.frames, old.summary()["finished"]) == (2, False)
        assert old.bodies(1)["position"].shape == (4, 3)  # read from the file only now


def test_no_run_and_no_checkpoint_are_reported(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        prepare_resume(tmp_path / "none")
    with pytest.raises(InputError, match="no checkpoint"):
        prepare_resume(tmp_path)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_cut_checkpoint_is_refused(copy, share):
    data = (copy / FILE).read_bytes()
    (copy / FILE).write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match="checkpoint.npz.*damaged"):
        prepare_resume(copy)


def test_a_flipped_byte_is_noticed_wherever_it_is(copy):
    data = bytearray((copy / FILE).read_bytes())
    rng = np.random.default_rng(5)
    for place in [0, len(data) - 1, *rng.integers(len(data), size=100)]:
        data[place] ^= 0x40
        (copy / FILE).write_bytes(data)
        with pytest.raises(InputError, match="checkpoint.npz: is damaged .its checksum is wrong"):
            read_checkpoint(copy)
        data[place] ^= 0x40


def test_a_checkpoint_of_another_scene_is_refused(tmp_path, copy):
    """Tables of another shape, which a compiled loop would read past their ends."""
    cut("roller_bearing", tmp_path / "other", 1)
    simulation, kept = prepare_resume(copy)
    other = read_checkpoint(tmp_path / "other")
    with pytest.raises(InputError, match=r"does not fit this scene \(S is missing|does not fit this scene \(. holds float64"):
        execute(simulation, copy, checkpoint=replace(kept, snapshot=other.snapshot))


RESTING = (
    STEEL
    + """\
[[debris]]
kind = "spheres"
material = "steel"
radius = "5 um"
count = 3
[domain]
size = ["80 um", "60 um"]
[plates]
lower = {material = "steel"}
[solver]
duration = "1 us"
integrator = "explicit"
[output]
every = "0.5 us"
"""
)


def test_a_run_in_which_nothing_touches_goes_on(tmp_path):
    """Its stable step is infinite, which a checkpoint must be able to tell."""
    scene = thirdbody.Scene.parse(RESTING)
    execute(prepare(scene), tmp_path / "whole")
    with pytest.raises(Interrupted):
        execute(prepare(scene), tmp_path / "cut", stop=after(3))
    simulation, kept = prepare_resume(tmp_path / "cut")
    assert kept.snapshot.notes["integrator"]["bound"]["stability"] == math.inf
    execute(simulation, tmp_path / "cut", checkpoint=kept)
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")


def test_a_trajectory_that_lost_frames_is_refused(copy):
    with h5py.File(copy / "run.vtkhdf", "r+") as file:
        file["series"].attrs.modify("NSteps", np.int64(0))
    with pytest.raises(InputError, match="has 0 frames"):
        prepare_resume(copy)


def test_time_between_checkpoints_does_not_change_the_run(tmp_path):
    scene = scene_of("sheared_debris")
    for name, every in (("often", 0.0), ("never", math.inf)):
        execute(prepare(scene), tmp_path / name, times=WallTimes(every))
    often, never = contents(tmp_path / "often"), contents(tmp_path / "never")
    assert [key for key in often if often[key] != never[key]] == []
