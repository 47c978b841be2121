"""A run that was put away and taken up again is bit for bit the run that was never stopped: every driver, every shipped scene."""

import itertools
import math
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from meetings import against_post
from shared_runs import PATH, PLATES, clumps
from slow import slow
from steel import SCENES, STEEL
from trajectories import contents
import thirdbody
from thirdbody.engine.guards import Ledger
from thirdbody.engine.snapshot import Snapshot, restore
from thirdbody.errors import InputError, Interrupted
from thirdbody.kernels.tables import DEBRIS, body_extra
from thirdbody.runner.checkpoint import FILE, read_checkpoint, write_checkpoint
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.run_folder import RunFolder
from thirdbody.runner.run_loop import RunLoop, WallTimes
from thirdbody.runner.simulate import execute, prepare

ALONE, IMPLICIT = {"contact.debris_contact": "none"}, {"solver.integrator": "implicit"}
RIGID = {"plates.upper.support": "rigid", "plates.upper.load": "1 mN"}
MEET = {"solver.distance": "0.6 um", "output.every": "0.2 um"}
FAST = {"plates.upper.motion.x.velocity": "1 m/s", "solver.integrator": "explicit", "solver.settle": "1 us"}
DRIVERS = {
    "Explicit": FAST | {"solver.distance": "0.1 um", "output.every": "0.05 um"},
    "Implicit": IMPLICIT | ALONE,
    "ImplicitEnsemble": IMPLICIT | ALONE | {
        "debris.0.count": 520, "domain.size": ["800 um", "600 um"], "solver.distance": "0.1 um", "output.every": "0.05 um",
    },
    "Implicit meeting": MEET,
    "Implicit together": IMPLICIT | ALONE | RIGID,
    "Implicit meeting together": MEET | RIGID,
}  # fmt: skip
"""Class of the integrator, and whether bodies meet or carry one plate together; two to four outputs each."""
SHORT, LONG = ({"solver.distance": way, "output.every": every} for way, every in (("0.2 um", "0.1 um"), ("2 um", "0.5 um")))
SMALL, MANY = {"debris.0.count": "100"}, {"debris.0.count": "600"}
CASES = {
    "sheared_debris": ("sheared_debris", {"debris.0.count": "30", "solver.distance": "0.5 um", "output.every": "0.1 um"}),
    "sheared_debris implicit": ("sheared_debris", ALONE | MANY | LONG),
    "roller_bearing": ("roller_bearing", SHORT),
    "sliding_flakes": ("sliding_flakes", SHORT | {"debris.0.count": "4"}),
    "sliding_flakes mdr": ("sliding_flakes", SHORT | ALONE | {"contact.level": "mdr"}),
    "three_spot": ("three_spot", {"solver.integrator": "explicit", "solver.distance": "2 nm", "output.every": "1 nm"}),
    "three_spot implicit": ("three_spot", {}),
    "scanned_debris": ("scanned_debris", {"debris.0.count": "8", "solver.distance": "0.1 um", "output.every": "0.05 um"}),
    "mixed_population": ("mixed_population", {"solver.distance": "0.1 um", "output.every": "0.05 um"}),
    "mixed_population rigid": ("mixed_population", ALONE | IMPLICIT | {"solver.distance": "0.5 um", "output.every": "0.1 um"}),
    "dense_layer": ("dense_layer", {
        "debris.0.count": "80", "domain.size": ["40 um", "40 um"], "solver.distance": "1 um", "output.every": "0.5 um",
        "solver.inertial_number": "0.02", "output.profiles": 10,
    }),
    "fretting": ("fretting", {"solver.duration": "0.5 us", "output.every": "0.1 us"}),
    "sticky_submicron": ("sticky_submicron", {
        "debris.0.count": "48", "domain.size": ["1.3 um", "1.1 um"], "solver.distance": "30 nm", "output.every": "10 nm",
    }),
    "yielding_debris": ("yielding_debris", SMALL | LONG),
    "yielding_debris explicit": ("yielding_debris", SHORT | {"debris.0.count": "20", "solver.integrator": "explicit"}),
    "pivoting": ("sheared_debris", SMALL | SHORT | {"effects.pivoting": {"damping": 0.3}}),
    "pivoting implicit": ("sheared_debris", ALONE | SMALL | LONG | {"effects.pivoting": {}}),
    "close_spots": ("sheared_debris", MANY | SHORT | {"effects.close_spots": {}}),
    "close_spots implicit": ("sheared_debris", ALONE | MANY | LONG | {"effects.close_spots": {}}),
    "punch_on_flat": ("punch_on_flat", {
        "debris.0.count": "24", "domain.size": ["100 um", "20 um"], "plates.upper.pressure.width": ["60 um", "20 um"],
        "plates.upper.pressure.load": "4 mN", "solver.duration": "60 ms", "output.every": "10 ms",
    }),
    "worn_by_debris": ("worn_by_debris", {"debris.0.count": "6", "solver.duration": "0.7 s"}),
    "fretting_rig": ("fretting_rig", MANY | {"solver.duration": "2 ms", "output.every": "1 ms"}),
}  # fmt: skip


def of_driver(name, **changes):
    text = against_post(2).text("implicit") if "meeting" in name else clumps(12, '["70 um", "60 um"]') + PLATES + PATH
    return thirdbody.Scene.parse(text).with_settings(DRIVERS[name] | changes)


def of_file(name):
    file, settings = CASES[name]
    return thirdbody.Scene.load(SCENES / f"{file}.toml").with_settings(settings)


def after(watches):
    counter = itertools.count(1)
    return lambda: next(counter) >= watches


def cut(simulation, folder, watches, **keys):
    try:
        execute(simulation, folder, stop=after(watches), **keys)
    except Interrupted:
        return True
    return False


def check_in_pieces(scene, folder):
    reference = prepare(scene)
    execute(reference, folder / "whole")
    schedule, state = reference.state.world.upper.schedule, reference.state
    moved = np.subtract(schedule.displacement_at(state.time), schedule.displacement_at(0.0))
    assert state.distance > 0.0
    # the displacement of every patch is the integral of the plate's velocity, a sum over steps: rounding of up to 1e5 of them
    assert state.patches.displacement == pytest.approx(np.tile(moved, (len(state.P), 1)), rel=1e-9, abs=1e-9 * state.distance)
    stopped, pieces = cut(prepare(scene), folder / "cut", 3), 0
    while stopped:
        pieces += 1
        simulation, kept = prepare_resume(folder / "cut")
        # each piece on another number of cores, and eight times as long as the one before
        stopped = cut(simulation, folder / "cut", 8**pieces, threads=1 + pieces % 2, checkpoint=kept)
    assert pieces > 0, "the scene is too short to be stopped"
    whole, joined = contents(folder / "whole"), contents(folder / "cut")
    assert whole.keys() == joined.keys() and [key for key in whole if whole[key] != joined[key]] == []
    assert simulation.state.patches.displacement.tobytes() == state.patches.displacement.tobytes()
    return reference, whole


@pytest.mark.parametrize("name", DRIVERS)
def test_a_run_in_pieces_by_every_driver(tmp_path, name):
    reference, _ = check_in_pieces(of_driver(name), tmp_path)
    integrator = reference.integrator
    words = [word for word in ("meeting", "together") if getattr(integrator, {"meeting": "meets"}.get(word, word), False)]
    assert " ".join([type(integrator).__name__, *words]) == name
    if "meeting" in name:
        with thirdbody.open(tmp_path / "whole") as run:
            assert np.any(run.contacts(-1)["side"] == DEBRIS), "the bodies must meet"


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize("name", CASES)
def test_a_run_in_pieces_is_the_whole_run(tmp_path, name):
    reference, whole = check_in_pieces(of_file(name), tmp_path)
    if name == "sticky_submicron":
        necks = reference.state.slots.records.contact_radius > 0.0
        assert necks.sum() > 20 and reference.state.E[:, body_extra.NORMAL_LOSS].sum() > 0.0
    bed = {"series/inertial_number", "series/accommodation_shear", "profiles/contact_stress"}
    assert bed <= whole.keys() or name != "dense_layer"


@pytest.mark.parametrize("islands", [True, slow(False)])
def test_a_run_stopped_between_two_strides_is_the_whole_run(tmp_path, islands):
    """Bodies that meet are searched once a stride: one that is done is not begun again."""
    scene = of_driver("Implicit meeting") if islands else of_file("close_spots")
    execute(prepare(scene), tmp_path / "whole")
    simulation, ends = prepare(scene), itertools.count()
    with pytest.raises(Interrupted):  # `earlier` is empty where a stride is done
        execute(simulation, tmp_path / "cut", stop=lambda: not simulation.integrator.earlier and next(ends) >= 3)
    again, kept = prepare_resume(tmp_path / "cut")
    with pytest.raises(Interrupted):  # at once, before its first search
        execute(again, tmp_path / "cut", times=WallTimes(limit=0.0), checkpoint=kept, overwrite=True)
    thirdbody.resume(tmp_path / "cut", progress=False).close()
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")


@pytest.mark.parametrize("driver", ["Explicit", slow("Implicit")])
def test_a_finished_run_goes_further(tmp_path, driver):
    whole = of_driver(driver, **{"output.every": "25 nm", "solver.distance": "0.1 um"})
    thirdbody.run(whole, tmp_path / "whole", progress=False)
    thirdbody.run(whole.with_settings({"solver.distance": "50 nm"}), tmp_path / "half", progress=False)
    thirdbody.resume(tmp_path / "half", progress=False, settings={"solver.distance": "0.1 um"})
    first, second = contents(tmp_path / "whole"), contents(tmp_path / "half")
    assert [key for key in first if first[key] != second[key]] == []
    with thirdbody.open(tmp_path / "half") as run:
        assert run.scene_text == whole.to_toml()


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("resume") / "cut"
    assert cut(prepare(of_driver("Explicit")), folder, 3)
    return folder


@pytest.fixture()
def copy(stopped, tmp_path):
    return Path(shutil.copytree(stopped, tmp_path / "run"))


def test_a_changed_scene_is_refused_with_the_difference(copy, monkeypatch):
    for settings, words in (
        ({"pairs.0.friction": "0.4"}, r"pairs\[0\].friction: was 0.3, is 0.4"),
        ({"output.every": "0.03 um"}, "output.every: was"),
        ({"solver.distance": "0.05 um"}, "solver.distance: 5e-08 is less than the 1e-07 of this run .*may only grow"),
        ({"solver.distance": None, "solver.duration": "1 s"}, "a run by distance goes on by distance"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=words):
            prepare_resume(copy, settings)
    monkeypatch.setattr("thirdbody.runner.checkpoint.__version__", "0.0.0")  # is told, and no fault
    assert any("taken up by another version" in text for text in prepare_resume(copy)[0].warnings)
    text = (copy / "scene.toml").read_text()
    (copy / "scene.toml").write_text(text.replace('level = "mindlin"', 'level = "mdr"'))
    with pytest.raises(InputError, match="contact.level: was mindlin, is mdr"):
        prepare_resume(copy)


def test_another_law_of_the_same_name_is_refused(tmp_path):
    """A plug-in that was edited between the two: its source is part of what the run was built from."""
    source = (SCENES.parent / "plugins" / "dmt_adhesion.py").read_text()
    plugin, other = tmp_path / "dmt_adhesion.py", tmp_path / "other" / "dmt_adhesion.py"
    plugin.write_text(source)
    other.parent.mkdir()
    other.write_text(source + "\nMORE = 1.0\n")
    scene = of_driver("Explicit", **{"effects.dmt_adhesion.work_of_adhesion": "50 mJ/m2"})
    with pytest.raises(Interrupted):
        execute(prepare(scene, [plugin]), tmp_path / "run", stop=after(2))
    prepare_resume(tmp_path / "run", plugins=[plugin])
    with pytest.raises(InputError, match="the contact laws: was .*dmt_adhesion"):
        prepare_resume(tmp_path / "run", plugins=[other])


def test_the_largest_pressure_before_the_stop_is_remembered(copy):
    simulation, kept = prepare_resume(copy)
    kept.pressure.update(ratio=1e3, pressure=1e12)
    kept.wall_time, kept.violations, loop = 1e5, 1, RunLoop(simulation, RunFolder(copy))
    loop.restore(kept)
    assert (loop.reached, loop.energy_guard.above) == (kept.stop, 1)
    execute(simulation, copy, checkpoint=replace(kept, violations=0), overwrite=True)
    with thirdbody.open(copy) as run:
        assert run.summary()["peak_pressure"] == 1e12 and run.summary()["wall_time"] > 1e5


def test_a_limit_of_wall_time_leaves_a_checkpoint(tmp_path):
    with pytest.raises(Interrupted, match=r"limit of wall time.*thirdbody\.resume\("):
        execute(prepare(of_driver("Explicit")), tmp_path / "run", times=WallTimes(limit=0.0))
    thirdbody.resume(str(tmp_path / "run" / "run.vtkhdf"), progress=False).close()


def test_resume_reads_what_it_wrote_though_the_interrupted_run_is_still_open(tmp_path):
    """As in a notebook: Ctrl-C, a look at what is there, resume. Only the checkpoint at the start was written by then."""

    def report(progress):
        if progress.frame == 2:
            raise KeyboardInterrupt

    folder = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        execute(prepare(of_driver("Explicit")), folder, 1, report)
    with thirdbody.open(folder) as old:
        assert (old.frames, old.summary()["finished"]) == (2, False)
        with thirdbody.resume(folder, threads=1, progress=False) as new:
            assert new.frames > 2 and new.summary()["finished"]
            assert new.series["time"][:2].tolist() == old.series["time"].tolist()
        assert (old.frames, old.summary()["finished"]) == (2, False)
        assert old.bodies(1)["position"].shape == (12, 3)  # read from the file only now


def test_no_run_no_checkpoint_and_lost_frames_are_reported(copy, tmp_path):
    with h5py.File(copy / "run.vtkhdf", "r+") as file:
        file["series"].attrs.modify("NSteps", np.int64(0))
    for folder, words in ((tmp_path / "none", "no such folder"), (tmp_path, "no checkpoint"), (copy, "has 0 frames")):
        with pytest.raises(InputError, match=words):
            prepare_resume(folder)


def test_a_cut_checkpoint_is_refused_and_a_flipped_byte_noticed_wherever_it_is(copy):
    data = bytearray((copy / FILE).read_bytes())
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        (copy / FILE).write_bytes(data[: int(share * len(data))])
        with pytest.raises(InputError, match="checkpoint.npz.*damaged"):
            prepare_resume(copy)
    for place in [0, len(data) - 1, *np.random.default_rng(5).integers(len(data), size=100)]:
        data[place] ^= 0x40
        (copy / FILE).write_bytes(data)
        with pytest.raises(InputError, match="checkpoint.npz: is damaged .its checksum is wrong"):
            read_checkpoint(copy)
        data[place] ^= 0x40


def test_a_checkpoint_of_another_scene_is_refused(tmp_path, copy):
    """Tables of another shape, which a compiled loop would read past their ends."""
    cut(prepare(of_driver("Explicit", **{"debris.0.count": 3})), tmp_path / "other", 1)
    (simulation, kept), other = prepare_resume(copy), read_checkpoint(tmp_path / "other")
    with pytest.raises(InputError, match=r"does not fit this scene \(S is missing|does not fit this scene \(. holds float64"):
        execute(simulation, copy, checkpoint=replace(kept, snapshot=other.snapshot))


def test_a_forged_checkpoint_is_refused_with_the_array(copy):
    """Its checksum is right, and compiled loops would read and write past the ends of tables."""
    (simulation, kept), far = prepare_resume(copy), 10**8
    arrays, notes, state = kept.snapshot.arrays, kept.snapshot.notes, simulation.state
    last = np.arange(len(arrays["slots_own"])) == len(arrays["slots_own"]) - 1
    for name, forged in (
        ("slots_own", np.where(last, far, arrays["slots_own"]).astype(np.int32)),
        ("slots_own", arrays["slots_own"][::-1].copy()),
        ("slots_own", arrays["slots_own"][None]),
        ("slots_partner", np.where(last, -far, arrays["slots_partner"]).astype(np.int32)),
        ("slots_H", arrays["slots_H"][:-1]),
        ("B", np.full_like(arrays["B"], np.nan)),
    ):
        with pytest.raises(ValueError, match=rf"^{name}"):
            restore(Snapshot(arrays | {name: forged}, notes), state, simulation.integrator, Ledger(state))
    with pytest.raises(ValueError, match="plates is 100000000, expected 0 to"):
        restore(Snapshot(arrays, notes | {"plates": far}), state, simulation.integrator, Ledger(state))
    for changes, words in (
        ({"stop": -1}, "checkpoint.npz: cannot be read .notes: stop is -1"),
        ({"impulses": np.zeros(99)}, "checkpoint.npz: does not fit this scene .impulses holds"),
        ({"pressure": kept.pressure | {"pair": [0, 7]}}, "checkpoint.npz: does not fit this scene .notes: pressure.pair is"),
    ):
        write_checkpoint(copy, replace(kept, **changes))
        with pytest.raises(InputError, match=words):
            thirdbody.resume(copy, progress=False)


def test_a_run_in_which_nothing_touches_goes_on(tmp_path):
    """Its stable step is infinite, which a checkpoint must be able to tell."""
    balls = '[[debris]]\nkind = "spheres"\nmaterial = "steel"\nradius = "5 um"\ncount = 3\n[domain]\nsize = ["80 um", "60 um"]\n'
    solver = '[plates]\nlower = {material = "steel"}\n[solver]\nduration = "1 us"\nintegrator = "explicit"\n'
    scene = thirdbody.Scene.parse(STEEL + balls + solver + '[output]\nevery = "0.5 us"\n')
    execute(prepare(scene), tmp_path / "whole")
    assert len(thirdbody.open(tmp_path / "whole").plates()["position"]) == 4  # no upper plate
    (tmp_path / "cut").mkdir()  # an empty folder is used
    assert cut(prepare(scene), tmp_path / "cut", 3)
    simulation, kept = prepare_resume(tmp_path / "cut")
    assert kept.snapshot.notes["integrator"]["bound"]["stability"] == math.inf
    execute(simulation, tmp_path / "cut", checkpoint=kept)
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")
    # bounds that wait until the step may grow are taken up too
    simulation, kept = prepare_resume(tmp_path / "cut")
    kept.snapshot.notes["integrator"]["waiting"] = [2e-9, 3e-9]
    restore(kept.snapshot, simulation.state, simulation.integrator, Ledger(simulation.state))
    assert simulation.integrator.export_state()[1] == kept.snapshot.notes["integrator"]


def test_time_between_checkpoints_does_not_change_the_run(tmp_path):
    for name, every in (("often", 0.0), ("never", math.inf)):
        execute(prepare(of_driver("Explicit")), tmp_path / name, times=WallTimes(every))
    often, never = contents(tmp_path / "often"), contents(tmp_path / "never")
    assert [key for key in often if often[key] != never[key]] == []
