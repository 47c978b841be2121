"""A run that was put away and taken up again is bit for bit the run that was never stopped, in every shipped scene."""

from __future__ import annotations

import itertools
import json
import math
import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from steel import STEEL
from trajectories import contents

import thirdbody
from thirdbody.engine.snapshot import Snapshot
from thirdbody.errors import InputError, Interrupted
from thirdbody.kernels.columns import body, body_extra, patch, run_totals, sphere, step_memory
from thirdbody.runner.checkpoint import FILE, NOTES, Checkpoint, read_checkpoint
from thirdbody.runner.resume import prepare_resume
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
        {"debris.0.count": "80", "domain.size": ["60 um", "50 um"], "solver.distance": "1 um", "output.every": "0.5 um"},
    ),
    "fretting": ("fretting", {"solver.duration": "0.5 us", "output.every": "0.1 us"}),
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


@pytest.mark.parametrize("name", CASES)
def test_a_run_in_pieces_is_the_whole_run(tmp_path, name):
    reference = prepare(scene_of(name))
    execute(reference, tmp_path / "whole")
    if reference.integrator.summary()["integrator"] == "explicit":
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
    assert whole.keys() == joined.keys()
    assert [key for key in whole if whole[key] != joined[key]] == []
    assert simulation.state.patches.displacement.tobytes() == reference.state.patches.displacement.tobytes()


def assert_plate_followed_schedule(state):
    """The displacement of every patch is the integral of the plate's velocity."""
    schedule = state.world.upper.schedule
    moved = np.subtract(schedule.place(state.time), schedule.place(0.0))
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
        execute(prepare(scene_of("sheared_debris")), tmp_path / "run", wall_limit=0.0)
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


def test_no_run_and_no_checkpoint_are_told(tmp_path):
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


def within_arrays(path: Path) -> np.ndarray:
    """For every byte of a zip, whether it is one of its files' own and no header's."""
    within = np.zeros(path.stat().st_size, bool)
    data = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        for item in archive.infolist():
            name, extra = struct.unpack_from("<HH", data, item.header_offset + 26)  # lengths behind a local header of 30 bytes
            begin = item.header_offset + 30 + name + extra
            within[begin : begin + item.file_size] = True
    return within


def as_text(kept: Checkpoint) -> dict[str, str | bytes]:
    """All that a run goes on from."""
    rest = replace(kept, impulses=np.zeros(0), snapshot=Snapshot({}, kept.snapshot.notes))
    return {name: array.tobytes() for name, array in kept.snapshot.arrays.items()} | {
        "impulses": kept.impulses.tobytes(), "rest": repr(rest),
    }  # fmt: skip


def test_a_flipped_byte_is_noticed_wherever_it_is(copy):
    """Every array has a checksum. Damage outside the arrays is told too, or nobody reads that byte (a time of the day)."""
    sound, within = as_text(read_checkpoint(copy)), within_arrays(copy / FILE)
    data = bytearray((copy / FILE).read_bytes())
    rng = np.random.default_rng(5)
    places = np.concatenate((rng.choice(np.flatnonzero(within), 60), rng.choice(np.flatnonzero(~within), 200)))
    refused = 0
    for place in places:
        data[place] ^= 0x40
        (copy / FILE).write_bytes(data)
        try:
            assert as_text(read_checkpoint(copy)) == sound and not within[place]
        except InputError:
            refused += 1
        data[place] ^= 0x40
    assert refused > 60


def forged(copy: Path, **changed: np.ndarray | None) -> None:
    """The checkpoint with arrays replaced, or left out, and sound checksums."""
    with np.load(copy / FILE) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays |= {name: array for name, array in changed.items() if array is not None}
    np.savez(copy / FILE, **{name: array for name, array in arrays.items() if changed.get(name, 0) is not None})


def test_forged_arrays_are_refused(copy):
    """Tables of another shape, and contacts of spheres that are not there, which a compiled loop would follow anywhere."""
    with np.load(copy / FILE) as archive:
        arrays = {name: archive[name] for name in archive.files}
    own, bodies = arrays["slots_own"], arrays["B"]
    lies = [
        {"B": bodies[:-1]}, {"B": bodies.astype(np.float32)}, {"B": None}, {"slots_own": own + 10_000}, {"slots_own": own[:-1]},
        {"slots_partner": arrays["slots_partner"] - 10_000}, {"slots_H": arrays["slots_H"][:, :-1]}, {"impulses": np.zeros(3)},
        {NOTES: np.frombuffer(b"{}", np.uint8)}, {NOTES: np.frombuffer(b"no JSON", np.uint8)},
    ]  # fmt: skip
    for lie in lies:
        forged(copy, **(arrays | lie))
        with pytest.raises(InputError):
            simulation, kept = prepare_resume(copy)
            execute(simulation, copy, checkpoint=kept)
    assert (copy / "run.vtkhdf").is_file()


def test_forged_numbers_that_no_run_has_are_refused(copy):
    """Bodies without mass, and a clock before the start, from which a run would go on for ever."""
    with np.load(copy / FILE) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name, columns in (
        ("B", (body.MASS,)),
        ("E", (body_extra.INERTIA + 2,)),
        ("S", (sphere.RADIUS, sphere.MASS)),
        ("P", (patch.MASS,)),
    ):
        for column in columns:
            other = arrays[name].copy()
            other[-1, column] = 0.0
            forged(copy, **(arrays | {name: other}))
            with pytest.raises(InputError, match=f"{name} holds other bodies or plates"):
                simulation, kept = prepare_resume(copy)
                execute(simulation, copy, checkpoint=kept)
    for column in (run_totals.TIME, run_totals.DISTANCE, run_totals.STEPS):
        other = arrays["A"].copy()
        other[column] = -1.0
        forged(copy, **(arrays | {"A": other}))
        with pytest.raises(InputError, match="its clock stands before the start"):
            prepare_resume(copy)
    forged(copy, **(arrays | {"A": None}))
    with pytest.raises(InputError, match="is damaged"):
        prepare_resume(copy)


@pytest.mark.parametrize(
    ("key", "lie"),
    [
        ("tightest", None), ("bound", {}), ("tightest.step", "x"), ("tightest.step", -math.inf), ("tightest.mechanism", 3),
        ("bound.stability", True), ("bound.step", 1e200), ("waiting", [None]), ("waiting", 1.0),
    ],
)  # fmt: skip
def test_forged_notes_of_the_time_step_are_refused(copy, key, lie):
    with np.load(copy / FILE) as archive:
        arrays = {name: archive[name] for name in archive.files}
    notes = json.loads(arrays[NOTES].tobytes())
    *above, last = key.split(".")
    node = notes["snapshot"]["integrator"]
    for part in above:
        node = node[part]
    node[last] = lie
    forged(copy, **(arrays | {NOTES: np.frombuffer(json.dumps(notes).encode(), np.uint8)}))
    with pytest.raises(InputError, match="does not fit this scene|is damaged"):
        simulation, kept = prepare_resume(copy)
        execute(simulation, copy, checkpoint=kept)


@pytest.mark.parametrize(
    ("table", "column", "lie"),
    [("totals", run_totals.TIME, -1e99), ("totals", run_totals.STEPS, 1e99), ("memory", step_memory.TRIES, 1e99)],
)
def test_forged_clocks_of_bodies_are_refused(tmp_path, table, column, lie):
    """A body that stands at no time of the run, or cannot count its trials up, would go on for ever."""
    folder = tmp_path / "cut"
    assert cut("sliding_flakes mdr", folder, 1)
    with np.load(folder / FILE) as archive:
        other = archive[f"integrator_{table}"]
    other[-1, column] = lie
    forged(folder, **{f"integrator_{table}": other})
    with pytest.raises(InputError, match=f"integrator_{table} holds times or counts that no run has"):
        simulation, kept = prepare_resume(folder)
        execute(simulation, folder, checkpoint=kept)


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
        execute(prepare(scene), tmp_path / name, every=every)
    often, never = contents(tmp_path / "often"), contents(tmp_path / "never")
    assert [key for key in often if often[key] != never[key]] == []
