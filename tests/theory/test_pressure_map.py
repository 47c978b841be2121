"""Pressure profiles from a CSV file, against the profiles of the theory sampled on a grid; a cylinder by its load per length."""

import math

import numpy as np
import pytest
from edge_rig import MODULUS, PLACES, SIZE, rig, zone_row
import thirdbody
from thirdbody.assembly.contact_zone import contact_zone, hertz_contact, values
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels import contact_zone as kernel
from thirdbody.kernels.tables import patch, run_totals, zone
from thirdbody.runner.checkpoint import prints_of
from thirdbody.scene import model
from thirdbody.scene.pressure import Hertz, PressureMap, Punch
from thirdbody.studies.copies import portable

HEADER = "x (um), y (um), pressure (MPa)"
integrators = pytest.mark.parametrize("integrator", ["explicit", "implicit"])


def write(path, x, y, row, scale, gap=False):
    """Write a profile at nodes [m], in any order of rows: `scale` is its largest pressure [Pa]."""
    lines = [HEADER + (", gap (um)" if gap else "")]
    for b in y:
        for a in x[::-1]:
            cells = [a * 1e6, b * 1e6, scale * kernel.pressure.py_func(a, b, row) * 1e-6]
            lines.append(", ".join(repr(float(c)) for c in (*cells, *([kernel.gap.py_func(a, b, row) * 1e6] if gap else []))))
    path.write_text("\n".join(lines) + "\n")
    return PressureMap(profile="table", table=str(path))


def built(make, profile, places=((0.5 * SIZE, 0.5 * SIZE),)):
    """The contact of a profile over the domain of `edge_rig`."""
    upper = model.UpperPlate(material="ball", support="load_per_particle", pressure=profile)
    plates = model.Plates(lower=model.LowerPlate(material="ball"), upper=upper)
    scene = make.scene([make.ball(1e-6, (2e-4, 2e-4, 1e-6))], {"ball": make.STEEL}, plates=plates, size=SIZE,
                       domain=model.Domain(size=(SIZE, SIZE), periodic=False))  # fmt: skip
    return contact_zone(scene, profile, MODULUS, np.array(places))[0]


def test_a_map_of_a_punch_is_the_punch(make, tmp_path):
    """Nodes at all corners of the profile: bilinear everywhere, so exact to rounding; rows in any order."""
    punch = zone_row(kernel.PUNCH, 8e-5, edge=2e-5)
    punch[zone.HALF_WIDTH + 1] = 5e-5
    x, y = np.arange(-9, 10) * 1e-5, np.arange(-7, 7) * 1e-5
    contact = built(make, write(tmp_path / "map.csv", x, y, punch, 3e6))
    assert contact.load == pytest.approx(3e6 * 1.6e-4 * 1e-4, rel=1e-12)
    assert contact.peak == pytest.approx(3e6, rel=1e-12) and contact.half_width == pytest.approx(8e-5, rel=1e-9)
    for a, b in np.random.default_rng(3).uniform(-1.2e-4, 1.2e-4, (500, 2)):
        # a flat body beyond the edge
        assert values(a, b, contact.row) == (pytest.approx(kernel.pressure.py_func(a, b, punch), abs=1e-12), 0.0)


@pytest.mark.parametrize(("body", "kind"), [("ball", kernel.BALL), ("cylinder", kernel.CYLINDER)])
def test_a_map_of_hertz_converges(make, tmp_path, body, kind):
    """Second order where the profile is smooth. The root at the edge leaves an error of the load of order 3/2,
    and around a circle these errors partly cancel."""
    a, radius, peak = 1e-4, 1e-2, 5e6
    exact = zone_row(kind, a, radius)
    load = peak * (2.0 / 3.0 * math.pi * a * a if body == "ball" else 0.5 * math.pi * a * SIZE)
    angles, where = np.random.default_rng(1).uniform(0.0, 2.0 * math.pi, 60), np.linspace(0.0, 0.6, 60)
    errors = []
    for n in (8, 16, 32, 64):
        # nodes that miss the edge by the same part of a spacing at each refinement
        x = (np.arange(-2 * n, 2 * n) + 0.5) * a / n
        y = x if body == "ball" else np.array([-0.5, 0.5]) * SIZE
        contact = built(make, write(tmp_path / "map.csv", x, y, exact, peak, gap=True))
        inside, outside = [], []
        for angle, r in zip(angles, where, strict=True):
            for at, k, found in ((r, 0, inside), (1.2 + r, 1, outside)):
                place = at * a * math.cos(angle), at * a * math.sin(angle)
                if kind == kernel.CYLINDER:
                    place = math.copysign(at * a, place[0]), place[1]
                scale = contact.peak / peak if k == 0 else 1.0
                found.append(scale * values(*place, contact.row)[k] - values(*place, exact)[k])
        errors.append([np.abs(inside).max(), np.abs(outside).max() / (a * a / radius), abs(contact.load / load - 1.0)])
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    # the largest of 60 samples scatters by the part of a cell that they hit; the last refinements are nearest to the limit
    assert np.mean(orders[1:, :2], axis=0) == pytest.approx([2.0, 2.0], abs=0.3)
    load_order = np.mean(orders[:, 2])
    assert load_order > 1.3 if body == "ball" else load_order == pytest.approx(1.5, abs=0.2)
    assert errors[-1][0] < 1e-3 and errors[-1][2] < 2e-3


@integrators
def test_bodies_do_the_same_under_a_map_of_the_punch(make, tmp_path, integrator):
    """Four balls, of which one leaves: loads of both differ by rounding."""
    motion = model.Motion(x=[model.Ramp(ramp=20.0, duration=1e-6), model.ConstantVelocity(velocity=20.0)])
    punch = Punch(profile="punch", width=(6e-5, SIZE), edge=4e-6, load=4e-4)
    row = zone_row(kernel.PUNCH, 3e-5, edge=4e-6)
    # from the middle of the domain; the gap of the chamfer, linear from 32 um on
    table = write(tmp_path / "map.csv", np.arange(-26, 27) * 4e-6, np.array([-0.5, 0.5]) * SIZE, row, 1e6, gap=True)
    places, found = [(-2.8e-5, 0.0), (0.0, 2e-5), (1e-5, -2e-5), (2e-5, 0.0)], []
    for profile in (punch, table.model_copy(update={"load": 4e-4, "out_after": 6e-5})):
        simulation = rig(make, places, profile, motion, integrator=integrator, settle=1e-6)
        state, ledger = simulation.state, Ledger(simulation.state)
        for time in (1e-6, 2.5e-6, 4e-6):
            simulation.integrator.advance_to(time=time, watch=lambda state=state, ledger=ledger: ledger.watch(state))
        lines = ledger.lines(state)
        assert ledger.relative_residual(state, lines["residual"]) < 2e-3
        P = state.P
        found.append([*state.bodies.position.ravel(), *P[:, patch.LOAD], *P[:, patch.HEIGHT], *state.A[run_totals.DIRECT_FORCE3]])
        assert np.count_nonzero(P[:, patch.INSIDE]) == 3
    # implicit steps may be accepted or not by a rounding: then by their tolerance, 5e-4 of a contact radius of some 30 nm
    assert found[0] == pytest.approx(found[1], rel=1e-6, abs=1e-11)


def test_a_load_scales_the_map_and_is_shared_by_position(make, tmp_path):
    row = zone_row(kernel.BALL, 6e-5, 1e-2)
    x = np.linspace(-6.4e-5, 6.4e-5, 65)
    table = write(tmp_path / "map.csv", x, x, row, 2e6)
    plain, scaled = built(make, table), built(make, table.model_copy(update={"load": 5e-3}))
    assert scaled.peak / plain.peak == pytest.approx(5e-3 / plain.load, rel=1e-12) and scaled.load == 5e-3
    assert plain.out_after == pytest.approx(2.0 * plain.half_width) and plain.border == 0.0
    simulation = rig(make, PLACES, table.model_copy(update={"load": 1e-3}), integrator="explicit")
    loads = simulation.state.P[:, patch.LOAD]
    shape = np.sqrt(np.maximum(1.0 - np.sum(PLACES**2, axis=1) / 6e-5**2, 0.0))
    # bilinear between nodes 2 um apart; next to the edge, at 45 of 60 um, 1/8 h^2 p'' is 4e-4 of the pressure
    assert loads == pytest.approx(1e-3 * shape / shape.sum(), rel=1e-3)


def test_a_map_that_ends_with_pressure_is_told(make, tmp_path):
    table = write(
        tmp_path / "map.csv", np.linspace(-3e-5, 3e-5, 9), np.array([-0.5, 0.5]) * SIZE, zone_row(kernel.UNIFORM, 0.0), 1e6
    )
    warnings = rig(make, PLACES, table, integrator="explicit").warnings
    assert any("ends in the domain at up to 1 of its largest pressure" in text for text in warnings)


GOOD = ("0,0,1", "1,0,2", "2,0,1", "0,1,1", "1,1,2", "2,1,1")


@pytest.mark.parametrize(("header", "rows", "message"), [
    ("x (um), pressure (MPa)", GOOD, "line 1: expected 'y (unit)', got 'pressure (MPa)'"),
    ("x (um), y (um), pressure (N)", GOOD, "line 1: '1 N' is a force, expected a pressure"),
    (HEADER + ", height (um)", GOOD, "line 1: expected 'gap (unit)', got 'height (um)'"),
    (HEADER, ("0,0,1", "1,0"), "line 3: expected 3 numbers, got 1, 0"),
    (HEADER, ("0,0,1", "1,0,nan"), "line 3: not a finite number"),
    (HEADER, ("0,0,1", "1,0,-3"), "line 3: pressure -3 MPa must be at least 0"),
    (HEADER + ", gap (um)", ("0,0,1,0", "1,0,0,-1"), "line 3: gap -1 um must be at least 0"),
    (HEADER, GOOD[:3], "needs at least two different y"),
    (HEADER, (), "holds no rows of numbers"),
    (HEADER, (*GOOD, "3,0,1", "4.3,0,1", "5,0,1"), "line 9: x 4.3 um is not on a regular grid of 1 um"),
    (HEADER, (*GOOD, "1,0,2"), "line 8: x 1 um, y 0 m occurs twice"),
    (HEADER, GOOD[:5], "has 5 rows for 3 x 2 nodes: x 2 um, y 1 um is missing"),
    (HEADER, [f"{row[:-1]}0" for row in GOOD], "the pressure is zero everywhere"),
])  # fmt: skip
def test_faults_of_a_map_name_line_and_value(make, tmp_path, header, rows, message):
    file = tmp_path / "map.csv"
    file.write_text("\n".join([header, *rows]))
    with pytest.raises(InputError) as caught:
        built(make, PressureMap(profile="table", table=str(file)))
    assert str(caught.value) == f"plates.upper.pressure.table: {file}: {message}"


def test_a_map_belongs_to_the_run_and_to_its_scene(make, tmp_path):
    """Another map is another run; a path is relative to the scene file, and copies of the scene find it."""
    row, x = zone_row(kernel.BALL, 6e-5, 1e-2), np.linspace(-6.4e-5, 6.4e-5, 33)
    prints = []
    for scale in (2e6, 3e6):
        table = write(tmp_path / "map.csv", x, x, row, scale)
        prints.append(prints_of(rig(make, PLACES, table, integrator="explicit")))
    assert {name for name in prints[0] if prints[0][name] != prints[1][name]} == {"the contact of the plates"}
    scene = thirdbody.Scene.load(thirdbody_scene(tmp_path))
    assert portable(scene).plates.upper.pressure.table == str(tmp_path / "map.csv")


def thirdbody_scene(folder):
    from steel import scene_text

    file = folder / "scene.toml"
    debris = '[[debris]]\nkind = "irregular"\nmaterial = "steel"\ncount = 5\nspheres = [4, 6]\naspect = [1.0, 0.8, 0.6]\n' \
             'size = {distribution = "constant", value = "2 um"}'  # fmt: skip
    upper = 'support = "load_per_particle"\npressure = {profile = "table", table = "map.csv"}'
    file.write_text(scene_text(debris, '["200 um", "200 um"]', upper))
    return file


def test_a_cylinder_takes_its_load_per_length(make):
    """Half width and peak of a line load (K. L. Johnson, Contact Mechanics, 1985, 4.43 and 4.45)."""
    keys = {"profile": "hertz", "body": "cylinder", "radius": 1e-2}
    contact, same = built(make, Hertz(**keys, load_per_length="500 N/m")), built(make, Hertz(**keys, load=500.0 * SIZE))
    assert contact.load == pytest.approx(500.0 * SIZE, rel=1e-14)
    half = math.sqrt(4.0 * 500.0 * 1e-2 / (math.pi * MODULUS))
    assert contact.half_width == pytest.approx(half, rel=1e-12) and contact.peak == pytest.approx(1000.0 / (math.pi * half))
    assert np.array_equal(contact.row, same.row)
    assert hertz_contact(Hertz(**keys, load=1.0), 500.0 * SIZE, SIZE, MODULUS)[0] == pytest.approx(half, rel=1e-12)


@pytest.mark.parametrize(("keys", "message"), [
    ({"body": "ball"}, "load: required key is missing"),
    ({"body": "cylinder"}, "give one of load, load_per_length"),
    ({"body": "ball", "load_per_length": "3 N/m"}, 'load_per_length: is of body = "cylinder": a ball has a load'),
    ({"body": "cylinder", "load": "1 N", "load_per_length": "3 N/m"},
     "load_per_length: give only one of load, load_per_length: load is given too"),
    ({"body": "cylinder", "load_per_length": "3 N"}, "load_per_length: '3 N' is a force, expected a load per length"),
])  # fmt: skip
def test_either_load_of_a_cylinder(keys, message):
    with pytest.raises(InputError) as caught:
        Hertz(profile="hertz", radius="1 mm", **keys)
    assert str(caught.value) == message
