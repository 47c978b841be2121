"""Contact between bodies in the implicit integrator.

After every stride of the drag, the bodies that could meet within the next one are found: those connected by such pairs form an
island (`engine.islands`), which is advanced as one system of equations. Then the paths of all spheres are checked. Where two
spheres that were no candidates may have touched, their islands go back to the start of the stride and are advanced again as one;
under a common plate all bodies do. So the result does not depend on how far bodies were expected to move.
"""

from typing import Any

import numpy as np

from thirdbody.engine.candidates import AllRows, Numbers
from thirdbody.engine.islands import LARGEST, MARGIN, islands_of
from thirdbody.engine.measures import collect_measures, deposit_on_maps
from thirdbody.engine.neighbours import replace_pairs, search_pairs
from thirdbody.engine.state import Action, Array, Ints, State
from thirdbody.errors import GuardStop
from thirdbody.jit.threads import allowed_threads
from thirdbody.kernels.implicit.accept_step import ROUNDED
from thirdbody.kernels.implicit.control import BodyStop
from thirdbody.kernels.step_tables import sphere_path, step_memory
from thirdbody.kernels.tables import EVERYTHING, domain, patch, run_totals, sphere

REST, LATER = 200.0, 0.25
"""Largest time between two searches while the plates do not move: in Rayleigh times, or as a part of the time so far."""

STATE, SLOTS = ("B", "E", "orientations", "S", "P", "M"), ("Q", "H", "R")
"""Tables that a step changes: of a state, and of its candidates."""

COUNTS = ("searches", "largest_island", "in_islands", "repeated")
"""What is counted: searches, bodies of the largest island, sum over searches of bodies in islands, islands advanced again."""


class Meeting:
    """Search for islands of an `Implicit`, which builds on this module, and return to the start of a stride."""

    def __init__(self, integrator: Any) -> None:
        self.integrator = integrator
        self.counts, self._recent = np.zeros(len(COUNTS)), np.zeros(len(COUNTS))
        self._deposits: list[Array] = []  # of this stride, on maps of measures

    def summary(self) -> dict[str, Any]:
        searches, largest, inside, repeated = self.counts
        return {
            "searches": int(searches), "largest": int(largest), "repeated": int(repeated),
            "fraction_of_bodies": float(inside / max(searches, 1.0) / self.integrator.state.n_bodies),
        }  # fmt: skip

    def until(self, until: float) -> float:
        """Return the time [s], at most `until`, of the next search; also where the plates are at rest."""
        one = self.integrator
        now, sooner = one.state.time, until
        if one.schedule.path(now, until) == 0.0:
            sooner = min(until, now + max(REST * one.rayleigh, LATER * now))
        if not one.together or sooner == until:
            return sooner
        # all share their steps: no stop is added where no bodies are near each other now
        return sooner if len(search_pairs(one.state, MARGIN * one.stride)[0]) else until

    def advance_to(self, until: float, watch: Action, between: Action) -> None:
        one = self.integrator
        if not np.any(self._going & (one.totals[:, run_totals.TIME] < until)):
            return  # the run was stopped after this stride
        self.search()
        while True:
            one.advance_all(until, watch, between)
            own, partner = self._missed()
            if not len(own):
                break
            self._repeat(own, partner)
        for deposits in self._deposits:
            deposit_on_maps(one.state, deposits)
        self._deposits = []
        largest = max(self.counts[1], self._recent[1])
        self.counts += self._recent
        self.counts[1] = largest
        one.earlier = {}
        watch()

    def collect(self) -> None:
        """Collect what contacts have measured; deposits wait until the stride is accepted: bodies may go back to its start."""
        deposits = collect_measures(self.integrator.state)
        self._deposits += [deposits] if len(deposits) else []

    # -- search --

    @property
    def _going(self) -> np.ndarray:
        return self.integrator.memory[:, step_memory.CODE] == BodyStop.NONE

    @property
    def _meeting(self) -> np.ndarray:
        state = self.integrator.state
        return self._going & (state.P[state.patch, patch.INSIDE] >= 0.0)  # bodies that left the domain meet no others

    def search(self) -> None:
        one, state, going = self.integrator, self.integrator.state, self._meeting
        own, partner = search_pairs(state, MARGIN * one.stride)
        both = going[state.body[own]] & going[state.body[partner]]
        replace_pairs(state, own[both], partner[both])
        self._positions = state.S[:, :3].copy()
        self._begin_paths(np.ones(state.n_spheres, bool))
        # a run can go on from these copies only, until the end of the stride
        one.earlier = {name: table.copy() for name, table in self._tables().items()}
        self._recent[:] = 0.0
        self._connect()
        self._recent[0], self._recent[2] = 1.0, float(one.islands.in_islands)

    def _begin_paths(self, spheres: np.ndarray) -> None:
        """Let the paths of these `spheres` (n,), a mask, begin where they were at the last search."""
        one = self.integrator
        here = self._positions[spheres]
        one.paths[spheres] = np.column_stack((np.zeros(len(here)), here, here))

    def _connect(self) -> None:
        one = self.integrator
        slots = one.state.slots
        one.max_per_body = max(one.max_per_body, slots.max_per_body)
        one.connect(islands_of(one.state, slots, allowed_threads()))
        largest = int(one.islands.sizes.max())
        self._recent[1] = max(self._recent[1], largest if largest > 1 else 0)
        if largest > LARGEST and not one.accuracy.skip_unsolved:
            advice = "in a bed of several layers with solver.inertial_number, which tells the speed that is slow enough"
            if not one.together:
                advice = 'at a higher speed, or on_failure = "continue", to go on all the same'
            raise GuardStop(
                f"stopped at t = {one.state.time:.6g} s: {largest} bodies could meet within the next "
                f"{one.stride:.2g} m of sliding, and the implicit integrator solves them together: more than {LARGEST} "
                f'do not pay; integrator = "explicit", {advice}'
            )

    def _missed(self) -> tuple[Numbers, Numbers]:
        state, going, n = self.integrator.state, self._meeting, self.integrator.state.slots.n_plates
        own, partner = may_have_touched(state, self._positions, self.integrator.paths)
        known = np.isin(self._keys(own, partner), self._keys(state.slots.own[n:], state.slots.partner[n:]))
        new = ~known & going[state.body[own]] & going[state.body[partner]]
        return own[new], partner[new]

    def _keys(self, own: Numbers, partner: Numbers) -> np.ndarray:
        return own.astype(np.int64) * self.integrator.state.n_spheres + partner

    def _repeat(self, own: Numbers, partner: Numbers) -> None:
        """Make these pairs candidates, and return the islands that they connect to the last search."""
        one = self.integrator
        state, old, n = one.state, one.state.slots, one.state.slots.n_plates
        keys = np.union1d(self._keys(own, partner), self._keys(old.own[n:], old.partner[n:]))
        pairs = (keys // state.n_spheres).astype(np.int32), (keys % state.n_spheres).astype(np.int32)
        now, old.rows = old.rows, AllRows(one.earlier["slots_H"], one.earlier["slots_R"])
        replace_pairs(state, *pairs)
        one.earlier |= {"slots_H": state.slots.H, "slots_R": state.slots.R}
        state.slots, old.rows = old, now
        replace_pairs(state, *pairs)
        self._connect()
        number = one.islands.number
        back = np.isin(number, number[state.body[own]])
        self._recent[3] += len(np.unique(number[back]))
        self._put_back(back)

    # -- copies of the state --

    def _tables(self) -> dict[str, Array]:
        one = self.integrator
        tables = {name: getattr(one.state, name) for name in STATE}
        tables |= {f"slots_{name}": getattr(one.state.slots, name) for name in SLOTS}
        tables |= {"W": one.state.W} if one.state.physics.measures else {}
        tables |= {"drive": one.state.drive} if one.state.sprung else {}
        own = {"totals": one.totals, "memory": one.memory} | (one.plate.tables() if one.plate else {})
        return tables | {f"integrator_{name}": table for name, table in own.items()}

    def _put_back(self, bodies: np.ndarray) -> None:
        """Return some `bodies` (n,), a mask, to the start of the stride; all of them under a common plate."""
        one = self.integrator
        state, tables = one.state, self._tables()
        rows: dict[str, Any] = dict.fromkeys(tables, slice(None))
        if one.plate:
            bodies = np.ones(state.n_bodies, bool)
        else:
            patches, contacts = np.zeros(len(state.P), bool), bodies[state.body[state.slots.own]]
            patches[state.patch[bodies]] = True
            rows = dict.fromkeys(tables, bodies) | {"S": bodies[state.body], "P": patches}
            rows |= {"slots_H": contacts, "slots_R": contacts, "slots_Q": contacts[: len(state.slots.Q)]}
        for name, table in tables.items():
            table[rows[name]] = one.earlier[name][rows[name]]
        self._begin_paths(bodies[state.body])
        self._deposits = [each[~bodies[each[:, 0].astype(int)]] for each in self._deposits]


OUTLIER = 4.0
"""Paths longer than this many times those of 99 % of the spheres are those of single bodies that tip or fly. Their pairs are
found one by one: a grid for such distances would list all pairs of all bodies."""


def may_have_touched(state: State, positions: Array, swept: Array) -> tuple[Numbers, Numbers]:
    """Return the pairs of spheres of different bodies that may have touched: owners and partners. `positions`: (n, 3) of all
    spheres at the last search [m]; `swept`: their paths since then."""
    paths = ROUNDED * swept[:, sphere_path.LENGTH]
    usual = min(float(paths.max()), OUTLIER * float(np.quantile(paths, 0.99)))
    own, partner = search_pairs(state, 2.0 * usual + float(state.D[domain.REACH]))
    if np.any(paths > usual):
        own, partner = _with_fast(state, paths, np.flatnonzero(paths > usual), own, partner)
    # boxes around the paths: a body that chatters has a long path in a small box, one that slides a straight path in a large one
    low, high, radius = swept[:, sphere_path.LOW3], swept[:, sphere_path.HIGH3], state.S[:, sphere.RADIUS]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    between = np.abs(_nearest_images(state, middle[own] - middle[partner])) - half[own] - half[partner]
    near = np.linalg.norm(np.maximum(between, 0.0), axis=1) - radius[own] - radius[partner] <= state.D[domain.REACH]
    own, partner = own[near], partner[near]
    near = _smallest_gaps(state, positions, paths, own, partner) <= state.D[domain.REACH]
    return own[near], partner[near]


def _with_fast(state: State, paths: Array, fast: Ints, own: Numbers, partner: Numbers) -> tuple[Numbers, Numbers]:
    S, free, n = state.S, state.side == EVERYTHING, state.n_spheres
    keys = [own.astype(np.int64) * n + partner]
    for i in fast[free[fast]]:
        between = _nearest_images(state, S[:, :3] - S[i, :3])
        reach = S[:, sphere.RADIUS] + S[i, sphere.RADIUS] + paths + paths[i]
        near = free & (state.body != state.body[i]) & (np.sum(between**2, axis=1) < reach**2)
        j = np.flatnonzero(near)
        keys.append(np.minimum(i, j) * n + np.maximum(i, j))
    both = np.unique(np.concatenate(keys))
    return (both // n).astype(np.int32), (both % n).astype(np.int32)


def _nearest_images(state: State, between: Array) -> Array:
    for axis in (0, 1):
        length = max(float(state.D[domain.LENGTH_X + axis]), 0.0)
        if length > 0.0:
            between[:, axis] -= length * np.rint(between[:, axis] / length)
    return between


def _smallest_gaps(state: State, positions: Array, paths: Array, own: Numbers, partner: Numbers) -> Array:
    """Return the smallest gaps (n,) [m] of pairs of straight paths, less their largest deviations; -inf: they are too long."""
    S = state.S
    moved = S[:, :3] - positions
    strayed = 0.5 * np.sqrt(np.maximum(paths**2 - np.sum(moved**2, axis=1), 0.0))
    now = _nearest_images(state, S[own, :3] - S[partner, :3])
    # speeds along the paths are unknown, so the whole paths must be apart, not only simultaneous positions
    touch = S[own, sphere.RADIUS] + S[partner, sphere.RADIUS] + strayed[own] + strayed[partner]
    gaps = _apart(now, moved[own], moved[partner]) - touch
    # paths that are long enough to meet another image than the one that is nearest now
    reach = S[own, sphere.RADIUS] + S[partner, sphere.RADIUS] + paths[own] + paths[partner]
    lengths = state.D[domain.LENGTH_X : domain.LENGTH_X + 2]
    return np.where(reach < 0.5 * np.min(lengths, where=lengths > 0.0, initial=np.inf), gaps, -np.inf)


def _apart(between: Array, a: Array, b: Array) -> Array:
    """Return the smallest distances (n,) of segments a and b (n, 3). `between` (n, 3): vector from the end of b to the end of a.
    Closest points of two segments (Ericson 2005, Real-time collision detection, 5.1.9): those of the lines, then clipped."""
    start = between - a + b
    aa, bb, ab = np.sum(a * a, axis=1), np.sum(b * b, axis=1), np.sum(a * b, axis=1)
    along_a, along_b = np.sum(a * start, axis=1), np.sum(b * start, axis=1)

    def part(value: Array, by: Array) -> Array:
        return np.clip(np.divide(value, by, out=np.zeros_like(value), where=by > 0.0), 0.0, 1.0)

    s = part(ab * along_b - along_a * bb, aa * bb - ab * ab)
    t = part(ab * s + along_b, bb)
    s = part(ab * t - along_a, aa)
    return np.linalg.norm(start + s[:, None] * a - t[:, None] * b, axis=1)
