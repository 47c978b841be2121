"""Paths of planar particles at level `exact` against memory diagrams with all their pieces, at several frictions.

The judge solves the three conditions of equilibrium by itself, with the same straight steps: 100 of pressing, then the drag."""

from types import SimpleNamespace

import numpy as np
import pytest
import three_spot_theory as theory
from scipy.optimize import root
from slow import slow
from theory.memory_diagrams import MemoryDiagram
from thirdbody_three_spot import regime_map
from thirdbody_three_spot.balance import balance
from thirdbody_three_spot.regime_map import FRICTIONS, POSITIONS, computed_points

MATERIALS = {
    "upper": {"shear_modulus": 80e9, "poisson_ratio": 0.3},
    "lower": {"shear_modulus": 60e9, "poisson_ratio": 0.35},
    "particle": {"shear_modulus": 120e9, "poisson_ratio": 0.2},
}
CLOSING, DRAG, PRESSES, DRAGS = 10e-9, 6e-9, 100, 20
MICRO = 1e-6


def spot(side, x, radius, z=0.0):
    return {"side": side, "x": x * MICRO, "y": 0.0, "z": (2.0 if side == "upper" else -2.0) * MICRO + z, "radius": radius * MICRO}


PAPER = (spot("upper", 0.2, 2.0), spot("lower", -2.0, 1.0), spot("lower", 1.5, 1.5))
UNEVEN = (*PAPER, spot("upper", 0.9, 2.0, -4e-9))  # touches when the others are 4 nm deep


class Verifier:
    """The particle in equilibrium: w down, u along the drag, phi about y (Willert, Eqs. 1, 2, 6, 11)."""

    def __init__(self, spots, mu):
        self.up = np.array([s["side"] == "upper" for s in spots])
        self.x, self.z, radius = (np.array([s[key] for s in spots]) for key in ("x", "z", "radius"))
        self.gap = np.where(self.up, self.z[self.up].max() - self.z, self.z - self.z[~self.up].min())
        g, nu = (MATERIALS["particle"][key] for key in ("shear_modulus", "poisson_ratio"))
        moduli = []
        for is_up in self.up:
            other = MATERIALS["upper" if is_up else "lower"]
            pair = (other["shear_modulus"], other["poisson_ratio"], g, nu)
            moduli.append((theory.e_star(*pair), theory.g_star(*pair)))
        self.stiffness = np.array([4.0 / 3.0 * e * r**0.5 for (e, _), r in zip(moduli, radius, strict=True)])
        self.spots = [MemoryDiagram(k, mu, mu * e / m) for k, (e, m) in zip(self.stiffness, moduli, strict=True)]
        self.y, self.gained, self.shift = np.array([0.5 * CLOSING / PRESSES, 0.0, 0.0]), np.zeros(3), np.zeros(len(spots))

    def forces(self, y, closing, drag):
        """(overlaps, shifts, N, T, unbalanced forces)."""
        w, u, turn = y[0], y[1], y[2] / (2.0 * MICRO)
        overlap = np.where(self.up, closing - w - turn * self.x, w + turn * self.x) - self.gap
        shift = np.where(self.up, drag - u + turn * self.z, u - turn * self.z)
        tangential = []
        for one, d, slip in zip(self.spots, overlap, shift - self.shift, strict=True):
            trial = MemoryDiagram(one.stiffness, one.mu, one.kappa)
            trial.overlap, trial.pieces = one.overlap, list(one.pieces)
            trial.move(d, slip)
            tangential.append(trial.force)
        n, t, sign = self.stiffness * np.maximum(overlap, 0.0) ** 1.5, np.array(tangential), np.where(self.up, -1.0, 1.0)
        moment = (sign * n * self.x).sum() - (sign * t * self.z).sum()
        return overlap, shift, n, t, np.array([(sign * n).sum(), (sign * t).sum(), moment / (2.0 * MICRO)])

    def move(self, closing, drag):
        scale = self.stiffness.max() * closing**1.5

        def rest(z):
            return self.forces(z * CLOSING, closing, drag)[4] / scale

        z = root(rest, (self.y + self.gained) / CLOSING, tol=1e-15).x
        for _ in range(4):  # Newton's steps to rounding, which `root` leaves short of
            jacobian = np.column_stack([(rest(z + e) - rest(z - e)) / 2e-7 for e in 1e-7 * np.eye(3)])
            better = z - np.linalg.lstsq(jacobian, rest(z), rcond=1e-12)[0]
            z = better if np.abs(rest(better)).max() < np.abs(rest(z)).max() else z
        assert np.abs(rest(z)).max() < 1e-12
        overlap, shift, n, t, _ = self.forces(z * CLOSING, closing, drag)
        for one, d, slip in zip(self.spots, overlap, shift - self.shift, strict=True):
            one.move(d, slip)
        self.shift, self.y, self.gained = shift, z * CLOSING, z * CLOSING - self.y
        return n, t, self.y[:2], self.y[2] / (2.0 * MICRO)


OTHERS = [(PAPER, 0.3), (PAPER, 0.1), (PAPER, 0.6), (PAPER, 1.0), (UNEVEN, 1.0)]


@pytest.mark.parametrize(("level", "cases"), [slow("exact", [(UNEVEN, 0.3), *OTHERS]), slow("mdr", OTHERS[:1])])
def test_paths_agree_with_memory_diagrams(level, cases):
    """Newton's tolerance of 1e-12 of all forces, over the least stiff direction. `mdr` has 16 to 32 springs: 1e-3 of the forces
    in partial slip, and a few times more in sums of small differences, such as u."""
    off = {"exact": 1e-9, "mdr": 5e-3}[level]
    for spots, mu in cases:
        verify = Verifier(spots, mu)
        for k in range(1, PRESSES + 1):
            expected = [verify.move(CLOSING * k / PRESSES, 0.0)]
        expected += [verify.move(CLOSING, DRAG * k / DRAGS) for k in range(1, DRAGS + 1)]
        tables = {"materials": MATERIALS, "friction": {"upper": mu, "lower": mu}, "particle": {"spots": list(spots)}}
        result = balance(tables | {"path": {"indentation": CLOSING, "drag": DRAG, "steps": DRAGS}}, level)
        assert len(result.points) == DRAGS + 1 and not any("bends" in text for text in result.warnings)
        for point, (n, t, (w, u), phi) in zip(result.points, expected, strict=True):
            assert np.abs(np.array(point.N) - n).max() < off * n.max() and np.abs(np.array(point.T) - t).max() < off * n.max()
            assert abs(point.w - w) < off * CLOSING and abs(point.phi - phi) < off * CLOSING / MICRO
            assert set(point.spots) == {"slide"} or abs(point.u - u) < off * CLOSING  # where all slide any u balances


HALF = 0.5


def test_a_computed_particle_has_the_place_and_the_state_of_its_path(monkeypatch):
    monkeypatch.setattr(regime_map, "balance", lambda tables: tables)
    tables = regime_map._dragged(0.7, 0.25, 0.4)
    places = [tuple(float(s[key].split()[0]) / 4.0 for key in ("x", "z")) for s in tables["particle"]["spots"]]
    assert places == [(0.7, 0.5), (-0.25, -0.5), (0.25, -0.5)]  # over h
    assert tables["friction"] == {"upper": 0.4, "lower": 0.4} and "direction" not in tables["path"]  # toward -x
    for words, stopped, state in (
        ("rolling sliding", None, "rolling"), ("sticking sliding", None, "sliding"), ("sticking rolling", None, "sticking"),
        ("sticking sticking", "rolling", "sticking"), ("sticking sliding", "undecided", None), ("sticking sticking", None, None),
    ):  # fmt: skip
        points = [SimpleNamespace(label=label, spots=["stick"]) for label in words.split()]
        assert regime_map._regime(SimpleNamespace(points=points, stopped=stopped and SimpleNamespace(label=stopped))) == state


@pytest.mark.full(kind="slow")
def test_every_computed_particle_does_what_the_map_says():
    points = computed_points(HALF)
    assert len(points) == len(POSITIONS) * len(FRICTIONS)
    for point in points:
        # the ends t_min = x - L, t_max = x + L and -t_max (over h): on them the answer is open
        if min(abs(point.y - (point.x + end)) for end in (-HALF, HALF)) < 1e-3 or abs(point.y + point.x + HALF) < 1e-3:
            continue
        assert point.state == theory.regime(point.x, HALF, point.y), point
    assert {point.state for point in points} == {"rolling", "sticking", "sliding"}
