"""Absent means absent: an effect that a scene does not name leaves what an engine that never had it would give.

Such an engine is a registry with the effect, dashpot or labeller taken out. Compared are the names of the generated modules,
which hash their text and the source of all that they call, the columns that are remembered, the candidate contacts, every dataset
of the result file, and the ledger.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from balls import BALLS, edited

from thirdbody.assembly.simulation import Simulation, build
from thirdbody.engine.energy import Ledger
from thirdbody.engine.snapshot import snapshot
from thirdbody.kernels.columns import contact_state
from thirdbody.laws.codegen.contact_module import module_text
from thirdbody.laws.codegen.dependencies import plain, source_files
from thirdbody.laws.contract import BodyEffect, Law
from thirdbody.laws.registry import Registry, discover
from thirdbody.runner.simulate import execute
from thirdbody.scene.model import Scene
from thirdbody.trajectory.reader import FILE_NAME

DMT = Path(__file__).parents[2] / "plugins" / "dmt_adhesion.py"

SCENE = edited(
    BALLS,
    ('title = "four balls"\n', ""),
    ("count = 4", "count = 6"),
    ('["80 um", "60 um"]', '["60 um", "50 um"]'),
    ("[solver]", '[contact]\nlaw = "three_spot"\nlevel = "mindlin"\n[solver]\nintegrator = "explicit"'),
    ('distance = "0.1 um"\nsettle = "1 us"', 'distance = "40 nm"\nsettle = "0.2 us"'),
    ("0.05 um", "20 nm"),
)

EFFECTS = {
    "gravity": ["0 m/s2", "0 m/s2", "-9.81 m/s2"],
    "damping": {"rate": "1e3 1/s"},
    "local_damping": {"coefficient": 0.3},
    "rolling_resistance": {"coefficient": 0.05},
    "dmt_adhesion": {"work_of_adhesion": "50 mJ/m2"},
    "elastic_plastic": {},
    "pivoting": {},
    "adhesion": {"work_of_adhesion": "50 mJ/m2"},
    "close_spots": {},
}
ADDED = {
    "rolling_resistance": {"moment", "rolling_utilisation"},
    "elastic_plastic": {"plastic_work", "energy_plastic"},
    "pivoting": {"twist_moment", "twist_utilisation"},
    "adhesion": {"adhesion_work", "energy_adhesion", "agglomerate"},
}
"""Arrays that the effects of contacts add to the file: those that remember."""


def scene(**changes) -> Scene:
    return Scene.parse(SCENE).with_settings({key.replace("__", "."): value for key, value in changes.items()})


def engine(without: str = "") -> Registry:
    """All that is installed and the adhesion of the template, less one effect."""
    found = discover([DMT])
    return Registry(tuple(replace(p, effects=tuple(e for e in p.effects if e.name != without)) for p in found.plugins))


def less(family: str, **changes) -> Registry:
    """The same with a family changed; the other families of its plug-in and all labellers stay or go with it."""
    found = discover([DMT])
    return Registry(tuple(
        replace(p, families=tuple(replace(f, **changes) if f.name == family else f for f in p.families)) for p in found.plugins
    ))  # fmt: skip


def modules(built: Simulation) -> dict[str, str]:
    """Names of the generated modules of a scene, each of which holds a hash, and what its tangents would be generated from."""
    physics, laws = built.choice.physics, built.choice.chain.laws
    found = {name: plain(getattr(physics, name)).__module__ for name in ("law", "stiffness", "effects", "observe", "label")}
    assert found["law"] == built.choice.chain.path.stem
    files = source_files([law.kernel for law in laws] + [law.tangent for law in laws if law.tangent])
    return found | {"tangents": module_text(laws, tangents=True) + "".join(map(str, files))}  # compiling them would take minutes


def tables(built: Simulation) -> dict[str, object]:
    """What is kept per body, contact and pair: shapes, names, and the numbers that laws and effects are given."""
    state, physics = built.state, built.state.physics
    shapes = {name: getattr(state, name).shape for name in ("B", "S", "P", "M", "A")}
    slots = {name: getattr(state.slots, name).shape[1] for name in ("H", "F", "R")}
    return {
        **shapes, **slots, "history": physics.history, "pairs": physics.pairs.tolist(), "count": state.slots.count,
        "effects": physics.effect_parameters.tolist(), "flags": (physics.has_effects, physics.labels, physics.rolling),
        "memory": (physics.memory, physics.contact_memory), "spots": physics.interaction.tolist(),
    }  # fmt: skip


def results(built: Simulation, folder: Path) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Every dataset of the file of a run, and the ledger of its summary."""
    summary = execute(built, folder, threads=1)
    found: dict[str, np.ndarray] = {}
    with h5py.File(folder / FILE_NAME) as file:
        file.visititems(lambda name, node: found.update({name: node[()]}) if isinstance(node, h5py.Dataset) else None)
    found = {name: values for name, values in found.items() if not name.startswith("scene/")}  # texts, and the wall's time
    assert len(found) > 100, "bodies, spheres, contacts, plates and series"
    return found, summary["energy"]


def ends(names: Iterable[str]) -> set[str]:
    """What stands behind the last slash: an array and its offsets have the same name."""
    return {name.split("/")[-1] for name in names}


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_that_is_not_named_never_was(effect, tmp_path):
    bare, never = build(scene(), engine()), build(scene(), engine(without=effect))
    assert modules(bare) == modules(never)
    assert tables(bare) == tables(never)
    (first, ledger), (second, same) = results(bare, tmp_path / "bare"), results(never, tmp_path / "never")
    assert first.keys() == second.keys() and ledger == same
    for name in first:
        assert np.array_equal(first[name], second[name], equal_nan=first[name].dtype.kind == "f"), name


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_that_is_named_adds_its_own_and_nothing_else(effect, tmp_path):
    """Else the test above compares nothing: here the modules differ, and only the one that the effect belongs to."""
    bare, named = build(scene(), engine()), build(scene(**{f"effects__{effect}": EFFECTS[effect]}), engine())
    contact, body = isinstance(engine().effects[effect], Law), isinstance(engine().effects[effect], BodyEffect)
    differ = {name for name, module in modules(named).items() if modules(bare)[name] != module}
    # the stiffness stands in the module of the law, and so do tangents in one of their own; labels see forces on bodies
    # the interaction of spots is no kernel of a scene, but a table of numbers
    assert differ == ({"law", "stiffness", "tangents"} if contact else {"effects", "observe", "label"} if body else set())
    assert (len(named.state.physics.interaction) > 0) == (not contact and not body)
    # a law of moments has a spring and a dashpot, whose energy and moment are remembered with those of the others
    own = {name for name in named.state.physics.history if name.startswith((effect, "viscous.moment", "springs"))}
    assert set(named.state.physics.history) - own == set(bare.state.physics.history)
    assert bool(own) == (effect in ADDED)
    first, second = results(bare, tmp_path / "bare"), results(named, tmp_path / "named")
    added = {"energy_body_effects"} if body else ADDED.get(effect, set())
    assert ends(second[0].keys() - first[0].keys()) == added
    assert not first[0].keys() - second[0].keys()
    # no body effect, no line in the ledger; and their work is no rounding of zero with them
    assert "body_effects" not in first[1]
    assert (second[1].get("body_effects", 0.0) != 0.0) == body


def test_a_measure_that_is_not_named_never_was():
    """No module, no column of a contact or a body, no array of a checkpoint; one that is named has them, and the same laws."""
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
    assert (
        rough.state.slots.H.shape[1]
        == bare.state.slots.H.shape[1]
        == contact_state.MIN_WIDTH + 2 * rough.state.physics.contact_memory
    )


def test_without_a_labeller_no_body_has_labels(tmp_path):
    bare, labelled = build(scene(), less("three_spot", labeller=None)), build(scene(), engine())
    assert modules(bare)["law"] == modules(labelled)["law"] and modules(bare)["effects"] == modules(labelled)["effects"]
    assert bare.state.physics.memory == bare.state.physics.contact_memory == 0
    assert bare.state.slots.H.shape[1] == contact_state.LAW + len(bare.state.physics.history) < labelled.state.slots.H.shape[1]
    first, second = results(bare, tmp_path / "bare")[0], results(labelled, tmp_path / "labelled")[0]
    assert not any(word in name for name in first for word in ("state", "margin", "fraction_"))
    added = ends(second.keys() - first.keys())
    assert {"state", "state_reason"} <= added and any(name.startswith("fraction_") for name in added)
    # labels look on: what both files hold is the same to the last bit
    assert all(np.array_equal(first[name], second[name], equal_nan=first[name].dtype.kind == "f") for name in first)


def test_bodies_that_do_not_meet_are_not_searched_for():
    alone, together = build(scene(contact__debris_contact="none")), build(scene())
    assert modules(alone) == modules(together), "debris meets debris by the same laws"
    near = {"domain__size": ["40 um", "30 um"]}  # six balls of 10 um
    alone, together = build(scene(contact__debris_contact="none", **near)), build(scene(**near))
    assert np.all(alone.state.slots.partner < 0) and np.any(together.state.slots.partner >= 0)


def test_a_foundation_s_energy_appears_in_the_ledger_only_with_one(tmp_path):
    bare = build(scene())
    founded = build(scene(plates__upper__support="foundation", plates__upper__stiffness="1e5 N/m", plates__upper__load="0.6 mN"))
    first, second = results(bare, tmp_path / "bare"), results(founded, tmp_path / "founded")
    assert second[1].keys() - first[1].keys() == {"foundation"}
    assert second[0].keys() - first[0].keys() >= {"series/energy_foundation"}
    assert "series/energy_foundation" not in first[0]


def test_a_load_that_changes_is_no_other_law():
    """How the load changes is data of the plate: the generated code is that of a constant load, and so are all columns."""
    steady = build(scene())
    varied = build(scene(plates__upper__loading={"load": "0.2 mN", "duration": "20 ns"}))
    assert modules(steady) == modules(varied) and tables(steady) == tables(varied)
