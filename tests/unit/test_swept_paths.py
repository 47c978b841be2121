"""Pairs that may have touched between two searches, from what is kept of their paths."""

from __future__ import annotations

import numpy as np
import pytest
from balls import BALLS, edited

from thirdbody.assembly.simulation import build
from thirdbody.engine.swept_paths import may_have_touched
from thirdbody.kernels.columns import sphere_path
from thirdbody.scene.model import Scene

R, SIZE, STEPS = 5e-6, (8e-5, 6e-5), 40


@pytest.fixture(scope="module")
def built():
    """Twelve balls, 2 um from each other, in a box with periodic sides, with contact between them."""
    places = ", ".join(f'["{12 * (k % 4) + 6} um", "{12 * (k // 4) + 6} um", "5 um"]' for k in range(12))
    return build(Scene.parse(edited(BALLS, ("count = 4\nseed = 1", f"positions = [{places}]")))).state


@pytest.fixture
def state(built):
    places = built.S[:, :3].copy()
    yield built
    built.S[:, :3] = places


def walk(state, starts, steps):
    """Move the spheres from `starts` (n, 3) by `steps` (m, n, 3) [m]; the paths as steps of bodies keep them, and all places."""
    places = starts + np.concatenate((np.zeros((1, *starts.shape)), np.cumsum(steps, axis=0)))
    paths = np.zeros((len(starts), sphere_path.WIDTH))
    paths[:, sphere_path.LENGTH] = np.linalg.norm(steps, axis=2).sum(axis=0)
    paths[:, sphere_path.LOW3], paths[:, sphere_path.HIGH3] = places.min(axis=0), places.max(axis=0)
    state.S[:, :3] = places[-1]
    return paths, places


def met(places):
    """The pairs of balls that overlapped at one of the instants."""
    i, j = np.triu_indices(places.shape[1], 1)
    between = places[:, i] - places[:, j]
    for axis in (0, 1):
        between[..., axis] -= SIZE[axis] * np.rint(between[..., axis] / SIZE[axis])
    return {
        (int(a), int(b)) for a, b, near in zip(i, j, (np.linalg.norm(between, axis=2) < 2.0 * R).any(axis=0), strict=True) if near
    }


def found(state, starts, paths):
    return set(zip(*(side.tolist() for side in may_have_touched(state, starts, paths)), strict=True))


@pytest.mark.parametrize("drift", [0.0, 2e-7, 1e-6])
def test_no_pair_that_met_is_missed(state, drift):
    """Random walks, of balls that stay, that move on, and of one that flies."""
    rng, starts, number = np.random.default_rng(1), state.S[:, :3].copy(), 0
    for _ in range(20):
        steps = rng.normal(0.0, 2e-7, (STEPS, len(starts), 3)) + drift * rng.normal(size=(1, len(starts), 3))
        steps[:, 0] *= 10.0
        paths, places = walk(state, starts, steps)
        pairs = met(places)
        number += len(pairs)
        assert pairs <= found(state, starts, paths)
    assert number > 20


def test_a_ball_that_chatters_meets_only_what_it_can_reach(state):
    """It goes to and fro by 0.5 um, and 100 um in all; its neighbours are 2 um from it, and one 0.4 um."""
    starts = state.S[:, :3].copy()
    starts[6, 0] += 1.6e-6
    steps = np.zeros((200, len(starts), 3))
    steps[::2, 5, 0], steps[1::2, 5, 0] = 5e-7, -5e-7
    paths, _ = walk(state, starts, steps)
    assert found(state, starts, paths) == set()
    starts[6, 0] -= 1.6e-6 + 1.6e-6
    paths, _ = walk(state, starts, steps)
    assert found(state, starts, paths) == {(5, 6)}
