"""The quasi-static solver against closed forms (Willert, with its signs) and an independent path: one particle, two bodies."""

import itertools
import json
import math

import numpy as np
import pytest
import three_spot_theory as theory
from thirdbody_three_spot.balance import balance
from thirdbody.errors import InputError, UsageError

SOLVED = 1e-10  # Newton's tolerance of 1e-12 of the forces, divided by the share of the smallest force, and some round-off
OTHER = pytest.mark.full(kind="slow")
"""Levels whose chain only these tests compile: their laws have judges of their own, and `exact` has test_planar_paths here."""

LEVELS = ["mindlin", *(pytest.param(level, marks=OTHER) for level in ("coulomb", "mdr", "exact"))]
MATERIALS = {
    "upper": {"shear_modulus": 80e9, "poisson_ratio": 0.3},
    "lower": {"shear_modulus": 60e9, "poisson_ratio": 0.35},
    "particle": {"shear_modulus": 120e9, "poisson_ratio": 0.2},
}
E1, E2 = theory.e_star(80e9, 0.3, 120e9, 0.2), theory.e_star(60e9, 0.35, 120e9, 0.2)
X, H, CLOSING, R = (0.2e-6, -2e-6, 1.5e-6), 4e-6, 10e-9, (2e-6, 1e-6, 1.5e-6)
SLIDING = theory.tilted_state(X, E1, E2, R, CLOSING, 0.3 * H)


def spot(side, x, radius, y=0.0, z=None):
    return {"side": side, "x": x, "y": y, "z": (2e-6 if side == "upper" else -2e-6) if z is None else z, "radius": radius}


def clump(*x, **more):
    return {"clump": [{"center": (a, 0.0, 0.0), "radius": 1e-6} for a in x]} | more


PAPER = (spot("upper", X[0], R[0]), spot("lower", X[1], R[1]), spot("lower", X[2], R[2]))
EVEN = (spot("upper", 0.0, 1e-6), spot("lower", -1e-6, 1e-6), spot("lower", 1e-6, 1e-6))
SOLID = (
    spot("upper", 0.2e-6, 2e-6, 0.1e-6), spot("lower", -2e-6, 1e-6, -1e-6), spot("lower", 1.5e-6, 1.5e-6, -1e-6),
    spot("lower", 0.0, 1e-6, 1.5e-6),
)  # fmt: skip


def walk(spots=PAPER, mu=0.3, mu_lower=None, level="mindlin", weight=0.0, **path):
    """The paper's particle unless told otherwise: 12 nm of drag in 60 steps at an indentation of 10 nm. Finite, all of it."""
    path = {"drag": 12e-9, "steps": 60} | ({} if "load" in path else {"indentation": CLOSING}) | path
    particle = {"weight": weight} | (spots if isinstance(spots, dict) else {"spots": list(spots)})
    friction = {"upper": mu, "lower": mu if mu_lower is None else mu_lower}
    result = balance({"materials": MATERIALS, "friction": friction, "particle": particle, "path": path}, level)
    json.loads(result.to_json(), parse_constant=lambda word: pytest.fail(word))
    return result


def states(result):
    return [label for label, _ in itertools.groupby(point.label for point in result.points)]


@pytest.mark.parametrize("level", LEVELS)
def test_without_friction_and_in_gross_sliding_the_particle_tilts_as_the_closed_form(level):
    w, phi, forces = theory.tilted_state(X, E1, E2, R, CLOSING, 0.0)
    end = walk(mu=0.0, level=level, drag=0.0).points[0]
    assert end.N == pytest.approx(forces, rel=SOLVED, abs=0.0)
    assert (end.w, end.phi) == pytest.approx((w, phi), rel=SOLVED, abs=0.0)
    assert end.T == pytest.approx([0.0] * 3, abs=SOLVED * forces[0])
    for weight in (1e-5, 1e-4):
        forces = theory.tilted_normal_forces(X, E1, E2, R, CLOSING, weight)
        assert walk(mu=0.0, level=level, weight=weight, drag=0.0).points[0].N == pytest.approx(forces, rel=SOLVED, abs=0.0)
    # the springs of `mdr` fall short of mu N by 4e-4 at most, the forces by about as much over the smallest share, .29
    (w, phi, forces), end = SLIDING, walk(level=level).points[-1]
    assert end.N == pytest.approx(forces, rel=2e-3 if level == "mdr" else SOLVED, abs=0.0) and end.spots == ["slide"] * 3
    if level != "mdr":
        # the last spot reaches its limit to the solver's tolerance only
        assert end.T == pytest.approx([0.3 * n for n in forces], rel=SOLVED, abs=0.0)
        assert (end.w, end.phi) == pytest.approx((w, phi), rel=SOLVED, abs=0.0)
        assert end.N[1] / end.N[0] == pytest.approx(1.0 / 1.4, rel=SOLVED)  # (x_3 - x_1 + mu h)/(x_3 - x_2) = 2.5/3.5
        assert (end.label, end.reason) == ("sliding", "friction_limit")
        # the load of this state gives back its indentation; while the gap opens, each path has its own history
        assert walk(level=level, load=forces[0]).points[-1].indentation == pytest.approx(CLOSING, rel=SOLVED)


@pytest.mark.parametrize("mu, mu_lower, weight", [(0.2, 0.4, 0.0), (0.4, 0.2, 0.0), (0.3, 0.3, 1e-5)])
def test_the_weaker_side_slides_and_the_other_sticks(mu, mu_lower, weight):
    end = walk(mu=mu, mu_lower=mu_lower, weight=weight).points[-1]
    upper, lower = end.N[0], end.N[1] + end.N[2]
    assert lower - upper == pytest.approx(weight, abs=1e-11 * upper)
    assert end.T[0] == pytest.approx(min(mu * upper, mu_lower * lower), rel=SOLVED)
    assert end.T[0] == pytest.approx(end.T[1] + end.T[2], rel=SOLVED)
    margins = (end.margins["friction_upper"], end.margins["friction_lower"])
    assert max(margins) > 1e-2 and min(margins) == pytest.approx(0.0, abs=1e-9)
    # u and du are positive toward -x: the particle stays with the side that sticks; its middle leans by less than 1 nm
    assert end.label == "sliding" and abs(end.u - (12e-9 if margins[0] > margins[1] else 0.0)) < 4e-9


def test_every_point_of_a_path_is_in_balance():
    for spots, steps in ((PAPER, 20), (SOLID, 15)):
        result = walk(spots, weight=2e-6, steps=steps)
        place = np.array([(s["x"], s["y"], s["z"]) for s in spots])
        sign = np.where([s["side"] == "upper" for s in spots], 1.0, -1.0)
        for point in result.points:
            t = np.array(point.T)
            t = np.stack([-t, 0.0 * t], axis=1) if result.planar else t
            force = np.column_stack([sign[:, None] * t, -sign * np.array(point.N)])
            # Eqs. 1, 2 with weight, at the solver's tolerance of 1e-12 with room for the sums
            scale = 1e-11 * sum(point.N)
            assert np.abs(force.sum(axis=0) - (0.0, 0.0, 2e-6)).max() < scale
            assert np.abs(np.cross(place, force).sum(axis=0)).max() < scale * 3e-6


@OTHER
def test_the_path_of_the_exact_law():
    """The third spot slides first, and slip begins at an edge at once, however little (Cattaneo and Mindlin)."""
    result = walk(level="exact", drag=24e-9, steps=480)
    points = result.points
    first = [next(p.drag for p in points if p.spots[k] == "slide") for k in range(3)]
    assert first[2] < min(first[:2]) and states(result) == ["sticking", "sliding"]
    assert list(points[0].spots) == ["stick"] * 3 and all("stick" not in p.spots for p in points[1:])
    # a particle that slides stays where sliding reached it; the neutral motion is found to the tolerance over the stiffness
    slides = [p.u for p in points if p.label == "sliding"]
    assert np.ptp(slides) <= 1e-9 * slides[0]


@pytest.mark.parametrize("level", LEVELS)
def test_a_mirror_changes_the_signs_of_tangential_forces_and_tilt_only(level):
    there = walk([s | {"x": -s["x"]} for s in PAPER], level=level, steps=30, direction=(1.0, 0.0))
    for a, b in zip(walk(level=level, steps=30).points, there.points, strict=True):
        # two solves to 1e-12 of all forces; the springs' tangent is a difference, but what is solved is the same
        assert a.N == pytest.approx(b.N, rel=1e-9, abs=0.0) and a.T == pytest.approx([-t for t in b.T], rel=1e-8, abs=1e-13)
        assert (a.w, a.u, a.phi) == pytest.approx((b.w, -b.u, -b.phi), rel=1e-8, abs=1e-13)
        assert (a.label, a.reason, a.spots) == (b.label, b.reason, b.spots)


def test_a_planar_particle_is_the_same_in_space():
    """Turned about the vertical, with the drag, the particle of the plane is one in space; nothing moves it out of its plane."""
    c, s = 0.6, 0.8
    turned = [p | {"x": c * p["x"], "y": s * p["x"]} for p in PAPER]
    for a, b in zip(walk(steps=20).points, walk(turned, steps=20, direction=(-c, -s)).points, strict=True):
        assert a.N == pytest.approx(b.N, rel=1e-9, abs=0.0)
        assert b.phi == pytest.approx([-s * a.phi, c * a.phi, 0.0], rel=1e-7, abs=1e-12)
        assert np.array(b.T) == pytest.approx(np.outer(a.T, (-c, -s)), rel=1e-8, abs=1e-13)
        assert a.label == "sliding" or b.u == pytest.approx([-c * a.u, -s * a.u], rel=1e-6, abs=1e-15)


def test_forecast_of_the_paper_particle_which_slides_up_to_t_max():
    forecast = walk(drag=0.0).forecast
    assert (forecast.mu_required, forecast.t_min, forecast.t_max) == pytest.approx((0.0, -0.325, 0.55), abs=1e-12)
    assert forecast.possible == ["sticking", "sliding"] and walk(drag=0.0, mu=0.6).forecast.possible == ["sticking"]
    # w = m g/N_1 = 1/2; the lower side limits T/N_1 to (1 + w) mu_2 (Eq. 20)
    heavy = walk(drag=0.0, mu=0.9, mu_lower=0.56, weight=5e-5, load=1e-4).forecast
    assert (heavy.t_min, heavy.t_max) == pytest.approx(theory.planar_interval((0.2,), (-2.0, 1.5), 4.0, 0.5), rel=1e-9)
    assert heavy.possible == ["sticking"]
    end = walk(mu=0.55, drag=60e-9).points[-1]  # no blow-up at t_max
    assert end.label == "sliding" and end.N[2] < 1e-5 * end.N[0]  # N_3/N_1 = (.55 - mu) h/(x_3 - x_2) -> 0


@pytest.mark.parametrize("mu, ends, how", [(0.5, "sliding", "load"), (0.6, "rolling", "load"), (0.6, "rolling", "indentation")])
def test_above_t_max_the_particle_tips(mu, ends, how):
    result = walk(mu=mu, drag=100e-9, **({"load": 1e-4} if how == "load" else {}))
    end = result.points[-1]
    assert end.label == ends and states(result) == ["sticking", ends]
    if ends == "rolling":
        assert end.reason == "lift_off" and end.spots[2] == "open"
        onset = next(p for p in result.points if p.spots[2] == "open")  # later it leans by less, as it has turned
        assert onset.T[0] / onset.N[0] == pytest.approx(0.55, rel=SOLVED)  # t_max = (x_1 - x_2)/h
        assert (how == "indentation") == any("wedges" in line for line in result.warnings)


def test_a_particle_that_turns_a_third_of_the_drag_rolls():
    """Labels are those of a run: a window of 4 contact radii of drag closes, and its rotation is no elastic tilt."""
    turning = (
        spot("upper", 1.42e-6, 1e-6, y=0.56e-6), spot("upper", 1.58e-6, 1e-6, y=1.72e-6),
        spot("lower", 1.23e-6, 1e-6, y=0.2e-6), spot("lower", -0.05e-6, 1e-6, y=0.16e-6),
    )  # fmt: skip
    points = walk(turning, mu=0.33, load=1e-4, drag=0.8e-6, steps=80).points
    a = math.sqrt(1e-6 * max(points[-1].indentation, 1e-9))  # no contact radius is larger
    slides, rolls = (next(k for k, p in enumerate(points) if p.label == label) for label in ("sliding", "rolling"))
    turn = np.linalg.norm(points[rolls].phi) * 4e-6 / points[rolls].drag
    assert 0.05 < turn < 0.5  # too much to be elastic, too little to roll at once
    assert slides < rolls and points[rolls].drag <= 4.0 * a + 0.01e-6  # within a step of the drag
    assert {p.label for p in points[rolls:]} == {"rolling"}


def test_two_spots_hold_at_rest_and_turn_with_the_drag():
    result = walk((spot("upper", 0.0, 1e-6), spot("lower", 0.5e-6, 1e-6)))
    first = result.points[0]
    assert first.T[0] / first.N[0] == pytest.approx(-0.125, rel=SOLVED)  # tan alpha = (x_1 - x_2)/h (Eq. 16)
    assert (first.label, first.reason) == ("sticking", "indeterminate")
    assert first.margins["determinacy"] < 0.0 and states(result) == ["sticking", "rolling"]
    # three in the plane of the drag hold the particle; dragged across that plane it tips sideways and turns with the drag
    result = walk(direction=(0.0, 1.0), drag=60e-9)
    assert states(result) == ["sticking", "rolling"] and result.points[0].reason == "indeterminate"


@pytest.mark.parametrize("which", [zip, pytest.param(itertools.product, marks=OTHER)])
def test_odd_particles_end_finite(which):
    for spots, path in which((
        (spot("upper", 0.0, 1e-6), *2 * (spot("lower", 0.0, 1e-6),)), (spot("upper", 0.0, 1e-6), spot("lower", 0.0, 1e-6)),
        EVEN, SOLID, clump(0.0), clump(0.0, 1e-6),
    ), ({}, {"mu": 0.0}, {"mu": 1e9}, {"direction": (0.0, 1.0)}, {"load": 1e-4}, {"weight": 1e-5})):  # fmt: skip
        result = walk(spots, steps=8, **path)
        assert len(result.points) == 9 and result.stopped is None
        for point in result.points:
            assert min(point.N) >= 0.0 and np.all(np.isfinite(np.ravel(point.T)))


def test_what_has_no_static_state_and_what_has(monkeypatch):
    monkeypatch.setattr("thirdbody.statics.solver.CUTS", 2)
    result = walk((PAPER[0], PAPER[1]))
    assert result.points == [] and result.stopped is not None
    assert result.stopped.label == "rolling" and "no static state exists while it is pressed" in result.stopped.message
    assert 0.0 < result.stopped.indentation <= CLOSING
    # pressed outside its base without friction it tips
    spots = (spot("upper", 3e-6, 1e-6), *EVEN[1:])
    assert walk(spots, mu=0.0).stopped is not None
    forecast = walk(spots, mu=0.0, direction=(1.0, 0.0)).forecast  # dragged the other way it would need t = -1 to -.5
    assert (forecast.t_min, forecast.t_max, forecast.mu_required) == pytest.approx((-1.0, -0.5, 0.5))
    assert walk(spots, mu=0.6, steps=20).points[-1].label == "sliding"  # t_min = .5 <= mu <= t_max = 1
    # a heavy particle may rest without the upper body
    end = walk(weight=1e-3, drag=0.0).points[0]
    assert end.N[0] == 0.0 and end.spots[0] == "open" and end.N[1] + end.N[2] == pytest.approx(1e-3, rel=SOLVED)
    assert (end.label, end.reason) == ("sticking", "one_sided")


def test_what_cannot_be_requested_is_reported_in_one_sentence():
    for spots, change, fault, message in (
        (PAPER[:1], {}, InputError, "no spot on the lower side"), (PAPER[1:], {}, InputError, "no spot on the upper side"),
        (PAPER, {"level": "mindlim"}, UsageError, "did you mean 'mindlin'"),
        (PAPER, {"indentation": 1e-8, "load": 1e-4}, InputError, "give only one of indentation, load"),
        (clump(0.0, 1.0), {}, InputError, "connected|parts|touch"),
    ):  # fmt: skip
        with pytest.raises(fault, match=message):
            walk(spots, **change)


def test_clump_and_spots_are_one_particle():
    same = [spot(side, x, 1e-6, z=z) for x in (-0.5e-6, 0.5e-6) for side, z in (("upper", 1e-6), ("lower", -1e-6))]
    flat = walk(clump(0.0, 1e-6), steps=20).points
    for a, b in zip(flat, walk(same, steps=20).points, strict=True):
        assert a.N == pytest.approx(b.N, rel=1e-8) and a.phi == pytest.approx(b.phi, rel=1e-8, abs=1e-12)
    turned = clump(0.0, 1e-6, quaternion=(math.cos(0.2), 0.0, 0.0, math.sin(0.2)))
    across = walk(turned, steps=20, direction=(-math.cos(0.4), -math.sin(0.4))).points[-1]
    assert across.N == pytest.approx(flat[-1].N, rel=1e-7)  # neutral in yaw: only as good as the path


def test_a_solver_that_fails_next_to_a_balance_does_not_call_it_rolling(monkeypatch):
    """A tolerance below round-off cannot be met: the particle is in balance all the same."""
    monkeypatch.setattr("thirdbody.statics.solver.CONVERGED", 0.0)
    monkeypatch.setattr("thirdbody.statics.solver.ACCEPTED", 0.0)
    monkeypatch.setattr("thirdbody.statics.solver.CUTS", 1)
    result = walk(drag=0.0)
    assert result.stopped is not None and result.stopped.label == "undecided" and "tips" not in result.stopped.message
    assert result.stopped.load is None and 0.0 < result.stopped.indentation <= CLOSING
