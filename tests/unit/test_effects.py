"""Rolling resistance and local damping in a scene: what can be given, what is refused, how much of it a pair may override."""

import numpy as np
import pytest
from each import each
from shared_runs import PLATES, clumps

import thirdbody
from thirdbody.assembly.cautions import adhesion_remarks
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.tables import record
from thirdbody.scene.model import Scene

MATERIALS = """\
scene = 1
[materials]
steel = {youngs_modulus = "210 GPa", poisson_ratio = 0.30, density = "7850 kg/m3"}
brass = {youngs_modulus = "105 GPa", poisson_ratio = 0.34, density = "8500 kg/m3"}
[[pairs]]
between = ["steel", "brass"]
friction = 0.30
restitution = 0.60
PAIR
[[pairs]]
between = ["brass", "brass"]
friction = 0.30
restitution = 0.60
"""
LAYER = clumps(12, '["60 um", "50 um"]', MATERIALS).replace('"steel"\nkind', '"brass"\nseed = 1\nplacement = "layer"\nkind')
TEXT = LAYER + PLATES.replace("motion", 'damping = "7e-5 kg/s"\nmotion').replace("10 mm/s", "1 m/s")
TEXT += '[effects]\nEFFECTS\n[solver]\ndistance = "2 um"\nsettle = "3 us"\n[output]\nevery = "1 um"\n'

ROLLING = "rolling_resistance = {coefficient = 0.05}"


def scene(effects: str = "", pair: str = "") -> Scene:
    return Scene.parse(TEXT.replace("EFFECTS", effects).replace("PAIR", pair))


def report(*texts: str) -> str:
    with pytest.raises(InputError) as caught:
        build(scene(*texts))
    return str(caught.value)


def test_contacts_report_the_moment_only_if_it_is_named(tmp_path):
    with thirdbody.run(scene(), tmp_path / "bare", progress=False) as run:
        assert not {"moment", "rolling_utilisation"} & set(run.contacts(-1))
    with thirdbody.run(scene(ROLLING), tmp_path / "rolling", progress=False) as run:
        contacts = run.contacts(-1)
        size = np.linalg.norm(contacts["moment"], axis=1)
        assert size.max() > 0.0
        # the moment has no part about the normal; arrays are stored as float32
        assert np.abs(np.sum(contacts["moment"] * contacts["normal"], axis=1)).max() < 1e-6 * size.max()
        used = contacts["rolling_utilisation"]
        assert np.all((used >= 0.0) & (used < 1.0 + 1e-6)) and used.max() > 0.5


def test_the_ledger_of_a_sheared_layer_closes_and_moments_are_balanced():
    """As in the shipped scenes; and the body's torque is that of its contacts' forces and moments."""
    rolling = build(scene("rolling_resistance = {coefficient = 0.2, damping = 0.3}\nlocal_damping = {coefficient = 0.3}"))
    state, ledger = rolling.state, Ledger(rolling.state)
    rolling.integrator.advance_to(time=rolling.settle)
    rolling.integrator.advance_to(distance=2e-6, watch=lambda: ledger.watch(state))
    assert ledger.relative_residual(state, ledger.lines(state)["residual"]) < 1e-3
    slots = state.slots
    torque, between = np.zeros((state.n_bodies, 3)), 0
    for k in np.flatnonzero(slots.histories.slip > 0.0):
        R, own, other = slots.R[k], state.body[slots.own[k]], slots.partner[k]
        force = R[record.NORMAL_FORCE] * R[record.NORMAL3] + R[record.TANGENTIAL_FORCE3]
        torque[own] += np.cross(R[record.POINT3], force) + R[record.MOMENT3]
        if other >= 0:
            between += np.linalg.norm(R[record.MOMENT3]) > 0.0
            torque[state.body[other]] -= np.cross(R[record.PARTNER_POINT3], force) + R[record.MOMENT3]
    # sums of a few numbers in another order
    assert np.allclose(torque, state.bodies.torque, rtol=0.0, atol=1e-12 * np.abs(torque).max())
    assert between > 0, "the layer is crowded enough that bodies collide"


def test_a_pair_may_have_its_own_coefficient_if_the_effect_is_on():
    rows = build(scene(ROLLING, "rolling_friction = 0.2")).choice.rows
    assert [row[-1].mu_r for row in rows] == [0.2, 0.05]
    assert Scene.parse(scene(ROLLING, "rolling_friction = 0.2").to_toml()).pairs[0].rolling_friction == 0.2
    for key, remedy in (
        ("rolling_friction = 0.2", "rolling_resistance = {coefficient = ...}"),
        ('work_of_adhesion = "5 mJ/m2"', "adhesion = {work_of_adhesion = ...}"),
    ):
        words = f"pairs[0].{key.split()[0]}: the effect that it belongs to is off: add [effects] {remedy}"
        assert words in report("", key)


def adhesive(own: str, all_pairs: str = 'work_of_adhesion = "50 mJ/m2", ', model: str = "jkr") -> tuple[str, str]:
    return f'adhesion = {{{all_pairs}model = "{model}"}}', f'work_of_adhesion = "{own}"'


def test_a_pair_may_have_its_own_work_of_adhesion():
    """In the parameters, the pull-off force and the reach; `check` tells it pair by pair."""
    built = build(scene(*adhesive("20 mJ/m2")))
    first, second = (row[0].adhesion * row[0].e_star for row in built.choice.rows)
    assert (first, second) == pytest.approx((0.02, 0.05), rel=1e-12)
    for pull_off, factor in (
        (built.state.physics.pull_off, 1.5), (build(scene(*adhesive("20 mJ/m2", model="dmt"))).state.physics.pull_off, 2.0)
    ):  # fmt: skip
        assert pull_off is not None
        assert pull_off(np.array([0, 1]), np.full(2, 1e-6)) == pytest.approx(factor * np.pi * 1e-6 * np.array([0.02, 0.05]))
    texts = [(pair, text.partition(",")[0]) for pair, text, _ in adhesion_remarks(built.choice, built.state)]
    assert texts == [("steel/brass", "w = 20 mJ/m2"), ("brass/brass", "w = 50 mJ/m2")]
    stronger = build(scene(*adhesive("2 J/m2")))
    assert stronger.choice.reach(1e-6) > 5.0 * built.choice.reach(1e-6)  # w^(2/3): that of the strongest pair


def test_work_of_adhesion_by_pair_only():
    """The effect's value may be left out where every pair has one; else the pairs that lack it are named: nothing is mixed."""
    message = report(*adhesive("20 mJ/m2", ""))
    assert "effects.adhesion: required key 'work_of_adhesion' is missing, and brass/brass of [[pairs]] give no" in message
    effects, own = adhesive("20 mJ/m2", "")
    text = scene(effects, own).to_toml()
    both = scene(effects, own).with_settings({"pairs.1.work_of_adhesion": "0 J/m2"})
    assert [row[0].adhesion for row in build(both).choice.rows][1] < 1e-25 and Scene.parse(text).pairs[0].work_of_adhesion == 0.02
    with pytest.raises(InputError, match=r"pairs\[0\].work_of_adhesion.*at least 0"):
        scene(effects, 'work_of_adhesion = "-1 J/m2"')


FAULTS = {
    "rolling_resistance = 0.05": "effects.rolling_resistance: expected a table with coefficient, damping",
    "rolling_resistance = {coefficient = 1.5}": "rolling_resistance.coefficient: 1.5 must lie between 0 and 1",
    "rolling_resistance = {damping = 0.1}": "required key 'coefficient' is missing",
    "local_damping = {coefficient = 0.95}": "local_damping.coefficient: 0.95 must lie between 0 and 0.9",
    'local_damping = {coefficient = 0.3, until = "ever"}': "local_damping.until: expected 'settled', got 'ever'",
}


@each(FAULTS)
def test_faults_are_reported(effects):
    assert FAULTS[effects] in report(effects)


def test_local_damping_may_say_when_it_ends():
    built = build(scene('local_damping = {coefficient = 0.3, until = "settled"}\ngravity = ["0 m/s2", "0 m/s2", "-9.81 m/s2"]'))
    assert built.choice.physics.effect_parameters.tolist() == [0.0, 0.0, -9.81, 0.3, built.settle]
