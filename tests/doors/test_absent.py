"""Absent means absent: an effect that a scene does not name leaves what an engine that never had it would give.

Such an engine is a registry with the effect, dashpot or labeller taken out. Compared are the names of the generated modules,
which hash their text and the source of all that they call, the columns that are remembered, the candidate contacts, every dataset
of the result file, and the ledger."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from balls import BALLS, edited
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.engine.snapshot import snapshot
from thirdbody.kernels.tables import contact_state
from thirdbody.laws.contract import BodyEffect, Law
from thirdbody.laws.generated import plain
from thirdbody.laws.registry import Registry, discover
from thirdbody.runner.simulate import execute
from thirdbody.scene.model import Scene
from thirdbody.trajectory.open_file import FILE_NAME

DMT = Path(__file__).parents[2] / "plugins" / "dmt_adhesion.py"
SCENE = edited(
    BALLS, ('title = "four balls"\n', ""), ("count = 4", "count = 6"), ('["80 um", "60 um"]', '["60 um", "50 um"]'),
    ("[solver]", '[contact]\nlaw = "three_spot"\nlevel = "mindlin"\n[solver]\nintegrator = "explicit"'),
    ('distance = "0.1 um"\nsettle = "1 us"', 'distance = "40 nm"\nsettle = "0.2 us"'), ("0.05 um", "20 nm"),
)  # fmt: skip
STICKY = {"work_of_adhesion": "50 mJ/m2"}
EFFECTS = {
    "gravity": ["0 m/s2", "0 m/s2", "-9.81 m/s2"], "damping": {"rate": "1e3 1/s"}, "local_damping": {"coefficient": 0.3},
    "rolling_resistance": {"coefficient": 0.05}, "elastic_plastic": {}, "pivoting": {}, "close_spots": {},
    "dmt_adhesion": STICKY, "adhesion": STICKY,
}  # fmt: skip
ADDED = {
    "rolling_resistance": {"moment", "rolling_utilisation"}, "elastic_plastic": {"plastic_work", "energy_plastic"},
    "pivoting": {"twist_moment", "twist_utilisation"}, "adhesion": {"adhesion_work", "energy_adhesion", "agglomerate"},
}  # fmt: skip
"""Arrays that the effects of contacts add to the file: those that remember."""


def scene(**changes):
    return Scene.parse(SCENE).with_settings({key.replace("__", "."): value for key, value in changes.items()})


def engine(without=""):
    found = discover([DMT])
    return Registry(tuple(replace(p, effects=tuple(e for e in p.effects if e.name != without)) for p in found.plugins))


def less(family, **changes):
    """The same with a family changed; the other families of its plug-in and all labellers stay or go with it."""
    found = discover([DMT])
    return Registry(tuple(
        replace(p, families=tuple(replace(f, **changes) if f.name == family else f for f in p.families)) for p in found.plugins
    ))  # fmt: skip


def modules(built):
    """Names of the generated modules of a scene, each of which holds a hash; tangents stand in the module of the law."""
    physics = built.choice.physics
    found = {name: plain(getattr(physics, name)).__module__ for name in ("law", "stiffness", "effects", "observe", "label")}
    assert found["law"] == built.choice.chain.module.__name__
    return found


def tables(built):
    """What is kept per body, contact and pair: shapes, names, and the numbers that laws and effects are given."""
    state, physics = built.state, built.state.physics
    shapes = {name: getattr(state, name).shape for name in ("B", "S", "P", "M", "A")}
    slots = {name: getattr(state.slots, name).shape[1] for name in ("H", "F", "R")}
    return {
        **shapes, **slots, "history": physics.history, "pairs": physics.pairs.tolist(), "count": state.slots.count,
        "effects": physics.effect_parameters.tolist(), "flags": (physics.has_effects, physics.labels, physics.rolling),
        "memory": (physics.memory, physics.contact_memory), "spots": physics.interaction.tolist(),
    }  # fmt: skip


def results(built, folder):
    summary = execute(built, folder, threads=1)
    found: dict[str, np.ndarray] = {}
    with h5py.File(folder / FILE_NAME) as file:
        file.visititems(lambda name, node: found.update({name: node[()]}) if isinstance(node, h5py.Dataset) else None)
    found = {name: values for name, values in found.items() if not name.startswith("scene/")}  # texts, and the wall's time
    assert len(found) > 100, "bodies, spheres, contacts, plates and series"
    return found, summary["energy"]


def ends(names):
    return {name.split("/")[-1] for name in names}


QUICK = ("gravity", "rolling_resistance", "adhesion", "close_spots")
SLOW = pytest.mark.full(kind="slow")
effects = pytest.mark.parametrize("effect", [name if name in QUICK else pytest.param(name, marks=SLOW) for name in EFFECTS])


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    built = build(scene(), engine())
    return built, modules(built), tables(built), *results(built, tmp_path_factory.mktemp("bare") / "run")


def equal(first, second):
    return np.array_equal(first, second, equal_nan=first.dtype.kind == "f")


@effects
def test_an_effect_that_is_not_named_never_was(effect, bare, tmp_path):
    never = build(scene(), engine(without=effect))
    _, names, kept, first, ledger = bare
    assert names == modules(never) and kept == tables(never)
    second, same = results(never, tmp_path / "never")
    assert first.keys() == second.keys() and ledger == same
    assert not [name for name in first if not equal(first[name], second[name])]


@effects
def test_an_effect_that_is_named_adds_its_own_and_nothing_else(effect, bare, tmp_path):
    """Else the test above compares nothing: here the modules differ, and only the one that the effect belongs to."""
    named, (built, names, _, first, ledger) = build(scene(**{f"effects__{effect}": EFFECTS[effect]}), engine()), bare
    contact, body = (isinstance(engine().effects[effect], kind) for kind in (Law, BodyEffect))
    differ = {name for name, module in modules(named).items() if names[name] != module}
    # the stiffness stands in the module of the law; labels see forces on bodies
    # the interaction of spots is no kernel of a scene, but a table of numbers
    assert differ == ({"law", "stiffness"} if contact else {"effects", "observe", "label"} if body else set())
    assert (len(named.state.physics.interaction) > 0) == (not contact and not body)
    # a law of moments has a spring and a dashpot, whose energy and moment are remembered with those of the others
    own = {name for name in named.state.physics.history if name.startswith((effect, "viscous.moment", "springs"))}
    assert set(named.state.physics.history) - own == set(built.state.physics.history) and bool(own) == (effect in ADDED)
    second, work = results(named, tmp_path / "named")
    assert ends(second.keys() - first.keys()) == ({"energy_body_effects"} if body else ADDED.get(effect, set()))
    assert not first.keys() - second.keys()
    # no body effect, no line in the ledger; and their work is no rounding of zero with them
    assert "body_effects" not in ledger and (work.get("body_effects", 0.0) != 0.0) == body


def test_a_measure_that_is_not_named_never_was():
    found = discover()
    bare, never = build(scene(), found), build(scene(), Registry(tuple(replace(p, measures=()) for p in found.plugins)))
    named = build(scene(measures__wear={"plates": "1e-15 m3/J"}), found)
    assert modules(bare) == modules(never) == modules(named)
    assert tables(bare) == tables(never) and bare.state.physics.measures is None and not bare.state.W.size
    saved = [set(snapshot(one.state, one.integrator, Ledger(one.state)).arrays) for one in (bare, never, named)]
    assert saved[0] == saved[1] and saved[2] - saved[0] == {"W", "maps"}
    layout = named.state.physics.measures.layout
    assert named.state.slots.H.shape[1] == bare.state.slots.H.shape[1] + layout.width
    assert np.array_equal(bare.state.slots.H, named.state.slots.H[:, : -layout.width])


@pytest.mark.parametrize("level", ["mindlin", pytest.param("mdr", marks=pytest.mark.full(kind="slow"))])
def test_elastic_pairs_have_no_dashpot(level):
    """Restitution 1 asks for no damping: the law is that of a family that has none."""
    dashpots = {"hertz_damping", "tangential_damping"}
    family = discover().families["three_spot"]
    levels = {name: tuple(law for law in laws if law.name not in dashpots) for name, laws in family.levels.items()}
    elastic = scene(contact__level=level, pairs__0__restitution=1.0)
    bare, never = build(elastic, engine()), build(elastic, less("three_spot", levels=levels))
    assert set(bare.choice.off) == dashpots and not dashpots & {law.name for law in bare.choice.chain.laws}
    assert modules(bare) == modules(never) and tables(bare) == tables(never)
    lossy = build(scene(contact__level=level), engine())
    springs = set() if level == "mindlin" else {"springs"}  # `mindlin` itself remembers what its spring stores
    assert modules(lossy)["law"] != modules(bare)["law"]
    assert {name.split(".")[0] for name in lossy.state.physics.history} == {level, "viscous"} | springs
    assert {name.split(".")[0] for name in bare.state.physics.history} == {level} | springs
    assert lossy.state.physics.pairs.size > bare.state.physics.pairs.size


def test_a_level_without_friction_remembers_nothing():
    bare, rough = (build(scene(contact__law="hertz_mindlin", contact__level=level)) for level in ("frictionless", "mindlin"))
    assert bare.state.physics.history == ("viscous.force",)  # which the ledger needs, not a law
    assert set(rough.state.physics.history) == {"viscous.force", "mindlin.force_x", "mindlin.force_y", "mindlin.energy"}
    widths = {one.state.slots.H.shape[1] for one in (rough, bare)}
    assert widths == {contact_state.MIN_WIDTH + 2 * rough.state.physics.contact_memory}


def test_without_a_labeller_no_body_has_labels(bare, tmp_path):
    labelled, names, _, second, _ = bare
    bare = build(scene(), less("three_spot", labeller=None))
    assert all(modules(bare)[name] == names[name] for name in ("law", "effects"))
    assert bare.state.physics.memory == bare.state.physics.contact_memory == 0
    assert bare.state.slots.H.shape[1] == contact_state.LAW + len(bare.state.physics.history) < labelled.state.slots.H.shape[1]
    first = results(bare, tmp_path / "bare")[0]
    assert not any(word in name for name in first for word in ("state", "margin", "fraction_"))
    added = ends(second.keys() - first.keys())
    assert {"state", "state_reason"} <= added and any(name.startswith("fraction_") for name in added)
    assert all(equal(first[name], second[name]) for name in first)  # labels look on: both files hold the same bits


def test_bodies_that_do_not_meet_are_not_searched_for_and_a_load_that_changes_is_no_other_law(bare):
    varied = build(scene(plates__upper__loading={"load": "0.2 mN", "duration": "20 ns"}), engine())
    assert modules(varied) == bare[1] and tables(varied) == bare[2]
    assert modules(build(scene(contact__debris_contact="none"), engine())) == bare[1], "debris meets debris by the same laws"
    near = {"domain__size": ["40 um", "30 um"]}  # six balls of 10 um
    alone, together = build(scene(contact__debris_contact="none", **near)), build(scene(**near))
    assert np.all(alone.state.slots.partner < 0) and np.any(together.state.slots.partner >= 0)


def test_a_foundation_s_energy_appears_in_the_ledger_only_with_one(bare, tmp_path):
    founded = build(scene(plates__upper__support="foundation", plates__upper__stiffness="1e5 N/m", plates__upper__load="0.6 mN"))
    (first, ledger), (second, founded_ledger) = bare[-2:], results(founded, tmp_path / "founded")
    assert founded_ledger.keys() - ledger.keys() == {"foundation"} and "series/energy_foundation" in second.keys() - first.keys()
