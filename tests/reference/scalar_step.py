"""The explicit engine's step, plainly: every body, every candidate, one after the other, in Python floats.

No compiled code, tiles, lists of what touches, rows of forces that are shared, or threads. It starts from the tables of a state,
takes the engine's candidates (the search is not judged here), and keeps the memory of a contact under the names of its spheres.
Only two things are the engine's own: the columns of the tables, and how many bodies and slots are summed together (`BODIES`,
`CHUNK`), for sums have the same bits only in the same order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from scalar_bodies import added, cross, drift, kick, place_now, spin_of, three
from scalar_contact import Done, Surroundings, interact, record, touches
from scalar_labels import look
from scalar_laws import Effects, Laws
from scalar_plates import Patches, Plan

from thirdbody.kernels import layout as at
from thirdbody.kernels import motion
from thirdbody.kernels.bodies import BODIES
from thirdbody.kernels.contacts import CHUNK
from thirdbody.kernels.rolling import MOMENTS

Pair = tuple[int, int]


class Reference:
    """A copy of a simulation at a synchronised instant, stepped without the engine. `B`, `S`, `P`, `A`, `M`: its tables."""

    def __init__(self, simulation: Any):
        state, choice = simulation.state, simulation.choice
        self.physics, self.choice = state.physics, choice
        self.B, self.S, self.P, self.A, self.M = (t.tolist() for t in (state.B, state.S, state.P, state.A, state.M))
        self.start, self.offsets = state.start.tolist(), [tuple(row) for row in state.offsets.tolist()]
        self.size = max(float(state.D[at.D_LX]), 0.0), max(float(state.D[at.D_LY]), 0.0)
        self.plan = Plan(state.schedule.tolist(), state.first.tolist())
        self.patches = Patches(self.P, state.patch.tolist(), self.plan)
        self.laws = Laws(choice.chain.laws, state.physics.pairs.tolist())
        self.effects = Effects(choice.effects, state.physics.effect_parameters.tolist())
        self.drag = simulation.integrator.drag
        self.memory: dict[Pair, list[float]] = {}
        self.records: dict[Pair, list[float]] = {}
        for pair, H, R in zip(pairs_of(state.slots), state.slots.H.tolist(), state.slots.R.tolist(), strict=True):
            self.memory[pair], self.records[pair] = H, R
        self.columns = state.slots.H.shape[1]
        self.opened = self.closed = 0
        self.take(state.slots)

    def take(self, slots: Any) -> None:
        """Other candidates, after a search of the engine's. A closed contact that is none of them is lost: AssertionError."""
        pairs = pairs_of(slots)
        assert {pair for pair, memory in self.memory.items() if memory[at.H_ON] != 0.0} <= set(pairs)
        self.pairs, self.kinds, self.plates = pairs, slots.kind.tolist(), slots.n_plates
        self.of_sphere: list[list[tuple[int, float]]] = [[] for _ in self.S]
        for k, (i, j) in enumerate(pairs):
            self.memory.setdefault((i, j), [0.0] * self.columns)
            self.records.setdefault((i, j), [0.0] * slots.R.shape[1])
            self.of_sphere[i].append((k, 1.0))
            if j >= 0:
                self.of_sphere[j].append((k, -1.0))

    def spheres(self, b: int) -> range:
        """Numbers of the spheres of a body."""
        return range(self.start[b], self.start[b + 1])

    def slots(self, b: int) -> list[tuple[int, float]]:
        """The slots of a body, sphere by sphere, with 1 for the owner and -1 for the partner."""
        return [entry for s in self.spheres(b) for entry in self.of_sphere[s]]

    def advance(self, steps: int, dt: float) -> None:
        """So many steps of velocity Verlet."""
        for _ in range(steps):
            self.step(dt)
        for b, B in enumerate(self.B):
            place_now(B, [self.S[s] for s in self.spheres(b)], [self.offsets[s] for s in self.spheres(b)])

    def step(self, dt: float) -> None:
        """One step, and what a labeller sees of it."""
        t = self.A[at.A_TIME]
        v = self.plan.rate(motion.X, t, dt), self.plan.rate(motion.Y, t, dt)
        sampled = self.physics.labels and (int(self.A[at.A_STEPS]) + 1) % self.physics.stride == 0
        self.patches.drive(t, dt)
        self.patches.drift(dt)
        for b, B in enumerate(self.B):
            drift(B, [self.S[s] for s in self.spheres(b)], [self.offsets[s] for s in self.spheres(b)], dt)
        world = Surroundings(self.P, v[0], v[1], dt, *self.size)
        done, lost = self.contacts(world)
        pushes = [self.gather(b, done, lost, t + dt, dt) for b in range(len(self.B))]
        groups = [in_order(pushes[first : first + BODIES]) for first in range(0, len(pushes), BODIES)]
        self.patches.load(t + dt)
        upward = 0.0
        for group in groups:
            upward -= group[2]
        self.patches.press(self.B, upward)
        self.account(self.spent(done, lost), groups, self.patches.kick(dt), v, dt)
        if sampled:
            look(self, v)
            self.A[at.A_ELAPSED], self.A[at.A_DX], self.A[at.A_DY] = 0.0, 0.0, 0.0

    def contacts(self, world: Surroundings) -> tuple[dict[int, Done], dict[int, float]]:
        """What the closed candidates do, and what the springs of those that have opened still held, J, by slot."""
        done, lost = {}, {}
        turns, moments = self.physics.rolling > 0, self.physics.rolling == MOMENTS
        for k, (i, j) in enumerate(self.pairs):
            memory = self.memory[i, j]
            if touches(self.S, i, j, world):
                self.closed += memory[at.H_ON] == 0.0
                done[k] = interact(self.S, i, j, self.kinds[k], memory, self.laws, turns, world)
                self.records[i, j] = record(self.S, i, j, done[k], world, moments)
            elif memory[at.H_ON] != 0.0:
                self.opened += 1
                lost[k] = memory[at.H_STORED]
                memory[:] = [0.0] * len(memory)
        return done, lost

    def gather(self, b: int, done: dict[int, Done], lost: dict[int, float], time: float, dt: float) -> list[float]:
        """Forces, torques and losses of a body, its closing half kick and its effects; returns the forces of the upper and of the
        lower plate on it (6) and the powers of the effects along the axes (3)."""
        B, none = self.B[b], (0.0, 0.0, 0.0)
        force, torque, plates = none, none, {True: none, False: none}
        for s in self.spheres(b):
            f, t = none, none
            for k, sign in self.of_sphere[s]:
                plate = k < self.plates
                share = 1.0 if plate else 0.5
                if k in lost:
                    B[at.B_WORK] += share * lost[k]
                if k not in done:
                    continue
                push = done[k].force[0] * sign, done[k].force[1] * sign, done[k].force[2] * sign
                f, t = added(f, push), added(t, done[k].q, done[k].half - self.S[s][at.S_R])
                if plate:
                    upper = self.pairs[k][1] < -1
                    plates[upper] = added(plates[upper], push)
                B[at.B_WORK] += share * done[k].answer.work
                B[at.B_SLIP] += done[k].answer.slip
            force = added(force, f)
            torque = added(torque, added(t, cross(three(self.S[s], at.S_ARM), f)))
        if self.physics.rolling == MOMENTS:
            for k, sign in self.slots(b):
                torque = added(torque, done[k].moment, sign) if k in done else torque
        kick(B, force, torque, dt)
        B[at.B_W : at.B_W + 3] = spin_of(B)
        powers = [0.0, 0.0, 0.0]
        if self.physics.has_effects:
            B[at.B_F : at.B_F + 3], B[at.B_T : at.B_T + 3] = force, torque
            acting = self.effects.on(B, time, dt)
            B[at.B_EF : at.B_EF + 3], B[at.B_ET : at.B_ET + 3] = acting[:3], acting[3:]
            kick(B, three(acting, 0), three(acting, 3), dt)
            B[at.B_W : at.B_W + 3] = spin_of(B)
            force, torque = added(force, three(acting, 0)), added(torque, three(acting, 3))
            powers = [acting[k] * B[at.B_V + k] + acting[3 + k] * B[at.B_W + k] for k in range(3)]
        B[at.B_F : at.B_F + 3], B[at.B_T : at.B_T + 3] = force, torque
        B[at.B_UP : at.B_UP + 3], B[at.B_LOW : at.B_LOW + 3] = plates[True], plates[False]
        return [*plates[True], *plates[False], *powers]

    def spent(self, done: dict[int, Done], lost: dict[int, float]) -> tuple[float, float]:
        """Work of friction and power of the dashpots: chunk by chunk, what opened first."""
        work, power = 0.0, 0.0
        for slots in self.chunks():
            part, dashpots = 0.0, 0.0
            for k in slots:
                part += lost.get(k, 0.0)
            for k in slots:
                if k in done:
                    part += done[k].answer.work
                    dashpots += done[k].answer.power
            work += part
            power += dashpots
        return work, power

    def chunks(self) -> list[range]:
        """Slots that are summed together: `CHUNK` in turn, plates apart; those of `BODIES` bodies where there are plates only."""
        n = len(self.pairs)
        if n == self.plates:
            body = [b for b in range(len(self.B)) for _ in self.spheres(b)]
            groups = [[k for k, (i, _) in enumerate(self.pairs) if body[i] // BODIES == g] for g in range(1 + body[-1] // BODIES)]
            return [range(g[0], g[-1] + 1) if g else range(0) for g in groups]
        flat = [range(first, min(first + CHUNK, self.plates)) for first in range(0, self.plates, CHUNK)]
        return flat + [range(first, min(first + CHUNK, n)) for first in range(self.plates, n, CHUNK)]

    def account(
        self, spent: tuple[float, float], groups: list[list[float]], patches: tuple[float, ...], v: tuple[float, float], dt: float
    ) -> None:
        """The step in the ledger, by the trapezoid, and on the clock."""
        A, half = self.A, 0.5 * dt
        sums = [0.0] * 6
        effects = 0.0
        for group in groups:
            sums = [sums[k] - group[k] for k in range(6)]
            effects += group[6]
        load, damping = patches[0] + patches[1], patches[2]
        A[at.A_FRICTION] += spent[0]
        A[at.A_DAMPING] += half * (A[at.A_POWER_DAMPING] + spent[1] + A[at.A_POWER_PATCH] + damping)
        A[at.A_EFFECTS] += half * (A[at.A_POWER_EFFECTS] + effects)
        drag = -half * ((A[at.A_UPPER] + sums[0]) * v[0] + (A[at.A_UPPER + 1] + sums[1]) * v[1])
        plate = drag + half * (A[at.A_POWER_LOAD] + load)
        A[at.A_PLATE_WORK] += plate
        A[at.A_PLATE_ABS] += abs(plate)
        for k in range(3):
            A[at.A_IMPULSE + k] += half * (A[at.A_UPPER + k] + sums[k])
            A[at.A_IMPULSE_LOW + k] += half * (A[at.A_LOWER + k] + sums[3 + k])
        A[at.A_UPPER : at.A_UPPER + 3], A[at.A_LOWER : at.A_LOWER + 3] = sums[:3], sums[3:]
        A[at.A_POWER_DAMPING], A[at.A_POWER_PATCH] = spent[1], damping
        A[at.A_POWER_EFFECTS], A[at.A_POWER_LOAD] = effects, load
        speed = math.sqrt(v[0] * v[0] + v[1] * v[1])
        for column, change in ((at.A_TIME, dt), (at.A_ELAPSED, dt), (at.A_DX, v[0] * dt), (at.A_DY, v[1] * dt),
                               (at.A_DISTANCE, speed * dt), (at.A_STEPS, 1.0)):  # fmt: skip
            A[column] += change
        A[at.A_SPEED] = speed
        if speed > 0.0:
            A[at.A_HEADING], A[at.A_HEADING + 1] = v[0] / speed, v[1] / speed


def pairs_of(slots: Any) -> list[Pair]:
    """Who meets whom, candidate by candidate."""
    return list(zip(slots.own.tolist(), slots.partner.tolist(), strict=True))


def in_order(pushes: Sequence[list[float]]) -> list[float]:
    """Sums over bodies: forces of the plates (6); the powers (3 each) go into one number."""
    sums = [0.0] * 7
    for push in pushes:
        sums[:6] = [sums[k] + push[k] for k in range(6)]
        for power in push[6:]:
            sums[6] += power
    return sums
