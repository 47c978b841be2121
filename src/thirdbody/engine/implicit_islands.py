"""Implicit integrator with contact between bodies.

After every stride of the drag, the bodies that could meet within the next one are found: those connected by such pairs form an
island (`engine.islands`), which is advanced as one system of equations; all others are advanced alone, as in `Implicit`. Then the
paths of all spheres are checked. Where two spheres that were no candidates may have touched, their islands go back to the start
of the stride and are advanced again as one. So the result does not depend on how far bodies were expected to move.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from thirdbody.engine.candidates import Numbers
from thirdbody.engine.contact_rows import AllRows
from thirdbody.engine.expected_islands import LARGEST, MARGIN, island_stride
from thirdbody.engine.implicit import Implicit
from thirdbody.engine.islands import Islands, islands_of
from thirdbody.engine.measures import collect_measures, deposit_on_maps
from thirdbody.engine.neighbours import replace_pairs, search_pairs
from thirdbody.engine.state import Array, State
from thirdbody.engine.swept_paths import may_have_touched
from thirdbody.errors import GuardStop
from thirdbody.jit.arguments import Packer
from thirdbody.jit.threads import allowed_threads, distribute
from thirdbody.kernels.implicit.island_bundles import TABLES
from thirdbody.kernels.implicit.island_driver import advance_part
from thirdbody.kernels.implicit.step_control import Stop
from thirdbody.kernels.implicit.tables import sphere_path, step_memory, step_settings, step_start
from thirdbody.kernels.tables import run_totals

REST, LATER = 200.0, 0.25
"""Largest time between two searches while the plates do not move: in Rayleigh times, or as a part of the time so far."""

RADII = 2.0
"""Longest drag of a step in radii of the largest contact (less than that of a body alone, `engine.accuracy`): in longer ones a
contact between bodies that begins to slide is labelled late."""

STATE, SLOTS = ("B", "E", "orientations", "S", "P", "M"), ("Q", "H", "R")
"""Tables that a step changes: of a state, and of its candidates."""

COUNTS = ("searches", "largest_island", "in_islands", "repeated")
"""What is counted: searches, bodies of the largest island, sum over searches of bodies in islands, islands advanced again."""

TOGETHER_ADVICE = "in a bed of several layers with solver.inertial_number, which tells the speed that is slow enough"
PATCHES_ADVICE = 'at a higher speed, or on_failure = "continue", to go on all the same'
"""What else a scene can do, where all bodies carry one plate and where each has a patch."""


class ImplicitIslands(Implicit):
    """`Implicit` for a state whose bodies have patches of their own and contact with each other."""

    meets = True

    def __init__(self, state: State, *arguments: Any, **options: Any) -> None:
        super().__init__(state, *arguments, **options)
        self.starts, self.paths = np.zeros((state.n_bodies, step_start.WIDTH)), np.zeros((state.n_spheres, sphere_path.WIDTH))
        self.counts, self._recent = np.zeros(len(COUNTS)), np.zeros(len(COUNTS))
        self._pack_tables = Packer(TABLES)
        self.settings[step_settings.RADII] = min(self.settings[step_settings.RADII], RADII)
        self.islands: Islands
        self._saved: dict[str, Array] = {}
        self._deposits: list[Array] = []  # of this stride, on maps of measures

    def start(self) -> None:
        """As `Implicit.start`."""
        super().start()
        slots = self.state.slots
        self._edges, self._incidence = slots.edges, slots.incidence
        self.stride = island_stride(self.state)
        self._search()

    def export_state(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """As `Implicit.export_state`."""
        arrays, notes = super().export_state()
        return arrays | {"counts": self.counts}, notes

    def restore(self, arrays: dict[str, Array], notes: dict[str, Any]) -> None:
        """As `Implicit.restore`."""
        super().restore(arrays, notes)
        self.counts[:] = arrays["counts"]
        self.earlier = {}  # `start` copied the tables that were replaced just now

    def summary(self) -> dict[str, Any]:
        """As `Implicit.summary`, with the number of searches, the largest island, and the mean fraction of bodies in islands."""
        searches, largest, inside, repeated = self.counts
        islands = {
            "searches": int(searches), "largest": int(largest), "repeated": int(repeated),
            "fraction_of_bodies": float(inside / max(searches, 1.0) / self.state.n_bodies),
        }  # fmt: skip
        return super().summary() | {"islands": islands}

    def _plate_candidates(self) -> tuple[Numbers, Numbers]:
        return self._edges, self._incidence

    def _until(self, until: float) -> float:
        """Return the time [s], at most `until`, of the next search; also where the plates are at rest."""
        now = self.state.time
        if self.schedule.path(now, until) > 0.0:
            return until
        return min(until, now + max(REST * self.rayleigh, LATER * now))

    def _advance_to(self, until: float, watch: Callable[[], None], between: Callable[[], None]) -> None:
        if not self._waiting(0, self.state.n_bodies, until):
            return  # the run was stopped after this stride
        self._search()
        while True:
            self._advance_all(until, watch, between)
            own, partner = self._missed()
            if not len(own):
                break
            self._repeat(own, partner)
        for deposits in self._deposits:
            deposit_on_maps(self.state, deposits)
        self._deposits = []
        largest = max(self.counts[1], self._recent[1])
        self.counts += self._recent
        self.counts[1] = largest
        self.earlier = {}
        watch()

    def _advance_all(self, until: float, watch: Callable[[], None], between: Callable[[], None]) -> None:
        """Advance bodies alone, then islands."""
        codes = self.memory[:, step_memory.CODE]
        waiting = self.islands.member & (codes == Stop.NONE)
        codes[waiting] = Stop.WAITS
        try:
            super()._advance_to(until, watch, between)
        finally:
            codes[waiting] = Stop.NONE
        parts, tables, context = self.islands.parts, self._pack_tables(self.islands.tables), self._context()

        def advance_islands(tries: float) -> None:
            distribute(range(parts), lambda: lambda part: advance_part(part, until, tries, context, tables))

        while going := self._going(until):
            self._call(going, advance_islands)
            watch()
        self._collect()

    def _collect(self) -> None:
        """As in `Implicit`, but deposits wait until the stride is accepted: bodies may yet go back to its start."""
        deposits = collect_measures(self.state)
        self._deposits += [deposits] if len(deposits) else []

    def _going(self, until: float) -> int:
        """Return the number of bodies in islands that have not reached a time [s] and have not stopped."""
        tables, islands = self.islands.tables, self.islands
        if not islands.count:
            return 0
        first = tables.body_edges[:-1]
        stopped = np.maximum.reduceat(self.memory[tables.bodies, step_memory.CODE], first) > Stop.NONE
        late = self.totals[tables.bodies[first], run_totals.TIME] < until
        return int(islands.sizes[late & ~stopped].sum())

    # -- search --

    def _search(self) -> None:
        """Find the pairs that can touch within the next stride, and the islands that they make; save the state."""
        state, going = self.state, self.memory[:, step_memory.CODE] == Stop.NONE
        own, partner = search_pairs(state, MARGIN * self.stride)
        both = going[state.body[own]] & going[state.body[partner]]
        replace_pairs(state, own[both], partner[both])
        self._positions = state.S[:, :3].copy()
        self._begin_paths(np.ones(state.n_spheres, bool))
        self._save()
        self._recent[:] = 0.0
        self._connect()
        self._recent[0], self._recent[2] = 1.0, float(self.islands.sizes.sum())

    def _begin_paths(self, spheres: np.ndarray) -> None:
        """Let the paths of these `spheres` (n,), a mask, begin where they were at the last search."""
        here = self._positions[spheres]
        self.paths[spheres] = np.column_stack((np.zeros(len(here)), here, here))

    def _connect(self) -> None:
        """Find the islands. Raises GuardStop where one of them is too large to pay."""
        slots = self.state.slots
        self.islands = islands_of(self.state, slots, allowed_threads())
        self.initial_overlaps, self.max_per_body = np.zeros(slots.count), slots.max_per_body
        largest = int(self.islands.sizes.max(initial=0))
        self._recent[1] = max(self._recent[1], largest)
        if largest > LARGEST and not self.accuracy.skip_unsolved:
            advice = TOGETHER_ADVICE if self.together else PATCHES_ADVICE
            raise GuardStop(
                f"stopped at t = {self.state.time:.6g} s: {largest} bodies could meet within the next "
                f"{self.stride:.2g} m of sliding, and the implicit integrator solves them together: more than {LARGEST} "
                f'do not pay; integrator = "explicit", {advice}'
            )

    def _missed(self) -> tuple[Numbers, Numbers]:
        """Return the pairs of spheres that may have touched since the last search without being candidates."""
        state, slots = self.state, self.state.slots
        own, partner = may_have_touched(state, self._positions, self.paths)
        pairs = slice(slots.n_plates, slots.count)
        known = np.isin(self._keys(own, partner), self._keys(slots.own[pairs], slots.partner[pairs]))
        going = self.memory[:, step_memory.CODE] == Stop.NONE
        new = ~known & going[state.body[own]] & going[state.body[partner]]
        return own[new], partner[new]

    def _keys(self, own: Numbers, partner: Numbers) -> np.ndarray:
        """Return a number for each pair, in the order of candidates."""
        return own.astype(np.int64) * self.state.n_spheres + partner

    def _repeat(self, own: Numbers, partner: Numbers) -> None:
        """Make these pairs candidates, and return the islands that they connect to the last search."""
        state, old, n = self.state, self.state.slots, self.state.slots.n_plates
        keys = np.union1d(self._keys(own, partner), self._keys(old.own[n:], old.partner[n:]))
        pairs = (keys // state.n_spheres).astype(np.int32), (keys % state.n_spheres).astype(np.int32)
        now, old.rows = old.rows, AllRows(self._saved["H"], self._saved["R"])
        replace_pairs(state, *pairs)
        self._saved |= {"H": state.slots.H, "R": state.slots.R}
        state.slots, old.rows = old, now
        replace_pairs(state, *pairs)
        self._name_saved()
        self._connect()
        number = self.islands.number
        back = np.isin(number, number[state.body[own]])
        self._recent[3] += len(np.unique(number[back]))
        self._put_back(back)

    # -- copies of the state --

    def _tables(self) -> dict[str, Array]:
        """Return all tables that steps change, by name."""
        tables = {name: getattr(self.state, name) for name in STATE}
        tables |= {name: getattr(self.state.slots, name) for name in SLOTS}
        tables |= {"W": self.state.W} if self.state.physics.measures else {}
        return tables | {"totals": self.totals, "memory": self.memory}

    def _save(self) -> None:
        """Copy them: a run can go on from here only, until the end of the stride (`earlier`)."""
        self._saved = {name: table.copy() for name, table in self._tables().items()}
        self._name_saved()

    def _name_saved(self) -> None:
        """Name the copies as `engine.snapshot` does."""
        prefix = dict.fromkeys((*STATE, "W"), "") | dict.fromkeys(SLOTS, "slots_")
        self.earlier = {prefix.get(name, "integrator_") + name: table for name, table in self._saved.items()}

    def _put_back(self, bodies: np.ndarray) -> None:
        """Return some `bodies` (n,), a mask, to the start of the stride."""
        state, tables = self.state, self._tables()
        patches = np.zeros(len(state.P), bool)
        patches[state.patch[bodies]] = True
        rows = dict.fromkeys(tables, bodies) | {"S": bodies[state.body], "P": patches}
        rows["H"] = rows["R"] = bodies[state.body[state.slots.own]]
        rows["Q"] = rows["H"][: len(state.slots.Q)]
        for name, table in tables.items():
            table[rows[name]] = self._saved[name][rows[name]]
        self._begin_paths(rows["S"])
        self._deposits = [rows[~bodies[rows[:, 0].astype(int)]] for rows in self._deposits]
