"""The labels' forecast under body forces against linear programmes of another solver and the closed form in the plane."""

import math

import friction_cones
import numpy as np
import pytest
import three_spot_theory as theory
from each import each
from slow import slow
from theory.plain import plain
from thirdbody_three_spot import classify, support
from thirdbody import plugin as k

EDGES = 64  # as ours, but with the edges elsewhere: each pyramid is within PYRAMID of its cone
PYRAMID = 1.0 / math.cos(math.pi / EDGES) - 1.0
BISECTION = 1e-4  # relative accuracy of our required friction
UM, LOAD, RADIUS = 1e-6, 1e-4, 5e-8  # m, N, contact radius in m
WRENCHES = {
    "weight": (0.0, 0.0, -0.3, 0.0, 0.0, 0.0),
    "buoyancy and a pull": (0.05, -0.03, 0.2, 0.0, 0.0, 0.0),
    "weight, pull and torque": (0.05, -0.03, -0.5, 0.02, 0.05, -0.03),
}  # over the load of the upper side, and that times a micrometre
LABELS = classify.label, classify.label_without_forecasts, classify.label_without_effects
LABEL, WITHOUT_FORECASTS, WITHOUT_EFFECTS = map(plain, LABELS)


def label(upper, lower, heights, wrench, frictions, drag, kernel=LABEL):
    """The forecast columns of the labeller for a body whose spots share the load of their side."""
    n = len(upper) + len(lower)
    C = np.zeros((n, k.loaded_contact.MEMORY + len(classify.CONTACT_MEMORY)))
    b, out, memory = np.zeros(k.observed_body.WIDTH), np.zeros(classify.OUTPUTS), np.zeros(len(classify.MEMORY))
    above = np.arange(n) < len(upper)
    C[:, k.loaded_contact.PARTNER] = np.where(above, k.UPPER, k.LOWER)
    C[:, k.loaded_contact.POINT : k.loaded_contact.POINT + 2] = UM * np.concatenate([upper, lower])
    C[:, k.loaded_contact.POINT + 2] = UM * np.where(above, *heights)
    C[:, k.loaded_contact.NORMAL + 2] = np.where(above, -1.0, 1.0)
    C[:, k.loaded_contact.CONTACT_RADIUS], C[:, k.loaded_contact.SPHERE_RADIUS] = RADIUS, UM
    C[:, k.loaded_contact.LOAD] = LOAD / np.where(above, len(upper), len(lower))
    C[:, k.loaded_contact.FRICTION_LIMIT] = np.where(above, *frictions) * C[:, k.loaded_contact.LOAD]
    b[k.observed_body.QUATERNION], b[k.observed_body.DRAG2] = 1.0, drag
    b[k.observed_body.EFFECT_FORCE : k.observed_body.EFFECT_FORCE + 6] = LOAD * np.array(wrench) * (1.0, 1.0, 1.0, UM, UM, UM)
    plain(classify.update_history)(C, n, b, memory)
    kernel(C, n, b, memory, out)
    return dict(zip(classify.EXTRAS, out[-len(classify.EXTRAS) :], strict=True))


def case(random):
    upper, lower = (random.uniform(-1.0, 1.0, (random.integers(1, 5), 2)) for _ in range(2))
    h, angle, mu = random.uniform(0.5, 2.0), random.uniform(0.0, 2.0 * math.pi), random.uniform(0.1, 1.5)
    top = random.uniform(0.3, 0.7) * h
    return upper, lower, (top, top - h), (mu, mu * random.choice([0.8, 1.0, 1.3])), (math.cos(angle), math.sin(angle))


def programme(upper, lower, heights, wrench, frictions, drag):
    """(bracket of the required friction, whether it can slide) by `cones`: the weaker friction, the other in proportion."""
    above = np.arange(len(upper) + len(lower)) < len(upper)
    points = np.column_stack([np.concatenate([upper, lower]), np.where(above, *heights)])
    normals = np.outer(np.where(above, -1.0, 1.0), (0.0, 0.0, 1.0))
    held = friction_cones.grasp(points, normals, np.where(above, *frictions), above, 1.0, wrench[:3], wrench[3:])
    pulls = np.outer(np.where(above, 1.0, -1.0), (*drag, 0.0))
    slides = any(friction_cones.can_slide(held, pulls, side, 256) for side in (above, ~above))
    return np.array(friction_cones.required_scale(held, EDGES, 1e-5)) * min(frictions), slides


ROWS = [("weight, pull and torque", 5), ("buoyancy and a pull", 3), *(slow(name, 20) for name in WRENCHES)]


@pytest.mark.parametrize(("wrench", "count"), ROWS)
def test_random_bodies_against_linear_programmes(wrench, count):
    random, outcomes = np.random.default_rng(2), []
    for _ in range(count):
        upper, lower, heights, frictions, drag = case(random)
        ours = label(upper, lower, heights, WRENCHES[wrench], frictions, drag)
        (low, high), slides = programme(upper, lower, heights, WRENCHES[wrench], frictions, drag)
        if math.isfinite(high):
            slack = PYRAMID + BISECTION
            assert low * (1.0 - slack) - 1e-4 <= ours["mu_required"] <= high * (1.0 + slack) + 1e-4
        else:
            assert ours["mu_required"] >= 1e9
        assert bool(int(ours["forecast"]) & 2) == slides
        assert bool(int(ours["forecast"]) & 1) == (ours["mu_required"] <= min(frictions))
        outcomes.append(slides)
    assert 0 < sum(outcomes) < count  # both occur


@each([0.02, 0.3, -0.4])
def test_in_the_plane_it_is_the_closed_form(w):
    """Spots in the plane of the drag; with w < 0 the body is pushed up, the lower side slides, and the mirror image is meant."""
    upper, lower, h = (-0.2, 0.5), (-0.9, 0.3, 1.1), 1.6
    above, below = ([(x, 0.0) for x in side] for side in (upper, lower))
    ours = label(above, below, (0.7, -0.9), (0, 0, -w, 0, 0, 0), (0.4, 0.4), (-1.0, 0.0))
    if w < 0.0:  # turned over about y: sides change places, and so does the sign of x
        upper, lower, w = [-x for x in lower], [-x for x in upper], -w / (1.0 + w)
    low, high = theory.planar_interval(upper, lower, h, w)
    assert (ours["t_min"], ours["t_max"]) == pytest.approx((low, high), rel=1e-6)  # the solver's residual of 1e-8, some times
    assert ours["forecast"] == 3.0 == 1.0 + 2.0 * (low <= 0.4 <= high)


def test_a_negligible_weight_leaves_the_closed_form_of_no_weight():
    upper, lower = [(1.2, 0.4)], [(-1.0, 0.0), (1.0, 0.0), (0.0, 1.2)]
    requested = [label(upper, lower, (1.0, -1.0), (0, 0, -w, 0, 0, 0), (0.5, 0.5), (-3.0, 1.0)) for w in (0.0, 1e-5, 1e-3, 2e-3)]
    assert requested[0] == requested[1]
    # both sides must hold: a body sticks where the smaller friction is enough
    for weaker, sticks in ((0.99, 0), (1.01, 1)):
        for factors in ((weaker, 1.5), (1.5, weaker)):
            mu = requested[0]["mu_required"] * np.array(factors)
            assert int(label(upper, lower, (1.0, -1.0), (0.0,) * 6, mu, (-3.0, 1.0))["forecast"]) & 1 == sticks
    # beyond that programmes take over, and the ends move with the weight: by w times a length of the body over its height
    slopes = [(found["t_max"] - requested[0]["t_max"]) / w for found, w in zip(requested[2:], (1e-3, 2e-3), strict=True)]
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-2) and 0.1 < abs(slopes[0]) < 2.0


def test_labels_without_forecasts_or_effects_differ_in_them_only():
    random = np.random.default_rng(3)
    body = case(random)
    weighted = *body[:3], WRENCHES["weight, pull and torque"], *body[3:]
    full, without = label(*weighted), label(*weighted, WITHOUT_FORECASTS)
    assert full["mu_required"] > 0.0 and [without.pop(name) for name in support.FORECASTS] == [k.NO_FORECAST, 0.0, 0.0, 0.0]
    assert without == {name: full[name] for name in without}
    for _ in range(4):
        body = case(random)
        free = *body[:3], (0.0,) * 6, *body[3:]
        assert label(*free) == label(*free, WITHOUT_EFFECTS)
