"""The explicit engine's step, plainly: every body, every candidate, one after the other, in Python floats.

No compiled code, tiles, lists of what touches, rows of forces that are shared, or threads. It starts from the tables of a state,
takes the engine's candidates (the search is not judged here), and keeps the memory of a contact under the names of its spheres.
Only the columns of the tables are the engine's own. Sums are taken in the order of the candidates and of the bodies, the
engine's in another, so that numbers agree to rounding."""

import math
from dataclasses import dataclass

import numpy as np
import scalar_bodies
from scalar_bodies import EFFECT_FORCE, EFFECT_TORQUE, UPPER_PUSH, act, added, cross, drift, kick, place_now, see_spin, three
from scalar_contact import Surroundings, interact, let_go, touches, update_labels, write_record
from scalar_laws import Effects, Laws
from thirdbody.kernels import schedule as motion
from thirdbody.kernels.tables import body, contact_state, domain, run_totals, sphere

TAKEN = {1: 10.0 / 3.0, 5: 14.0 / 3.0, 10: 14.0 / 3.0, 14: 10.0 / 3.0}
"""Steps of every 16, from 0 on, in which the spins of balls turn them, and for how many steps each stands."""


@dataclass
class Sums:
    """Work of friction and of dashpots, and elastic energies of contacts, J; forces of the debris on both plates, N."""

    work: float = 0.0
    damped: float = 0.0
    stored_n: float = 0.0
    stored_t: float = 0.0
    upper: tuple = (0.0, 0.0, 0.0)
    lower: tuple = (0.0, 0.0, 0.0)

    def press(self, force, lower):
        if lower:
            self.lower = added(self.lower, force, -1.0)
        else:
            self.upper = added(self.upper, force, -1.0)


class Reference:
    """A copy of a simulation at a synchronised instant, stepped without the engine. `B`, `S`, `P`, `A`, `M`: its tables."""

    def __init__(self, simulation):
        state, choice = simulation.state, simulation.choice
        self.physics, self.choice = state.physics, choice
        bodies, spheres = np.hstack((state.B, state.orientations, state.E)), state.S
        if spheres is state.B:  # rows of their own, with the same columns
            spheres = np.zeros((len(bodies), sphere.WIDTH))
            spheres[:, : sphere.END_VELOCITY] = state.B[:, : sphere.END_VELOCITY]
        self.B, self.P, self.A, self.M = (t.tolist() for t in (bodies, state.P, state.A, state.M))
        self.S, self.aliased = spheres.tolist(), state.S is state.B
        self.body, self.start = state.body.tolist(), state.start.tolist()
        self.offsets = [tuple(row) for row in state.offsets.tolist()]
        self.size = max(float(state.D[domain.LENGTH_X]), 0.0), max(float(state.D[domain.LENGTH_Y]), 0.0)
        self.plan = scalar_bodies.Plan(state.schedule.tolist(), state.first.tolist())
        self.patches = scalar_bodies.Patches(self.P, state.patch.tolist(), self.plan)
        self.laws = Laws(choice.chain.laws, state.physics.pairs.tolist())
        self.effects = Effects(choice.effects, state.physics.effect_parameters.tolist())
        self.drag = simulation.integrator.drag
        self.memory: dict = {}
        self.records: dict = {}
        for pair, H, R in zip(pairs_of(state.slots), state.slots.H.tolist(), state.slots.R.tolist(), strict=True):
            self.memory[pair], self.records[pair] = H, R
        self.columns = state.slots.H.shape[1]
        self.opened = self.closed = 0
        self.lost = 0.0
        self.take(state.slots)

    def take(self, slots):
        """Other candidates, after a search of the engine's. A closed contact that is none of them is lost: AssertionError."""
        pairs = pairs_of(slots)
        assert {pair for pair, memory in self.memory.items() if memory[contact_state.SLIP] != 0.0} <= set(pairs)
        self.pairs, self.kinds, self.plates = pairs, slots.kind.tolist(), slots.n_plates
        self.of_sphere: list[list[tuple[int, float]]] = [[] for _ in self.S]
        for k, (i, j) in enumerate(pairs):
            self.memory.setdefault((i, j), [0.0] * self.columns)
            self.records.setdefault((i, j), [0.0] * slots.R.shape[1])
            self.of_sphere[i].append((k, 1.0))
            if j >= 0:
                self.of_sphere[j].append((k, -1.0))

    def spheres(self, b):
        return range(self.start[b], self.start[b + 1])

    def slots(self, b):
        return [entry for s in self.spheres(b) for entry in self.of_sphere[s]]

    def advance(self, steps, dt):
        for _ in range(steps):
            self.step(dt)
        for b, B in enumerate(self.B):
            place_now(B, [self.S[s] for s in self.spheres(b)], [self.offsets[s] for s in self.spheres(b)])

    def step(self, dt):
        t = self.A[run_totals.TIME]
        v = self.plan.rate(motion.X, t, dt), self.plan.rate(motion.Y, t, dt)
        sampled = self.physics.labels and (int(self.A[run_totals.STEPS]) + 1) % self.physics.stride == 0
        self.patches.drive(t, dt)
        self.patches.drift(dt, *v)
        rotation = dt * TAKEN.get(int(self.A[run_totals.STEPS]) % 16, 0.0)
        for b, B in enumerate(self.B):
            drift(B, [self.S[s] for s in self.spheres(b)], [self.offsets[s] for s in self.spheres(b)], dt, rotation)
        spent = self.contacts(Surroundings(self.P, v[0], v[1], dt, *self.size))
        powers = [self.close(b, t + dt, dt) for b in range(len(self.B))]
        self.patches.load(t + dt)
        self.patches.press(self.B, spent.upper[2])
        self.account(spent, self.total(powers), self.patches.kick(dt), v, dt)
        if sampled:
            update_labels(self, v)
            self.A[run_totals.ELAPSED], self.A[run_totals.SHIFT_X], self.A[run_totals.SHIFT_Y] = 0.0, 0.0, 0.0

    def contacts(self, world):
        total = Sums()
        for k in self.order():
            if touches(self.S, *self.pairs[k], world):
                done = self.meet(k, world)
                total.work, total.damped = total.work + done.answer.work, total.damped + done.damped
                total.stored_n, total.stored_t = total.stored_n + done.answer.stored_n, total.stored_t + done.answer.stored_t
                if k < self.plates:
                    total.press(done.force, lower=self.pairs[k][1] == -1)
                self.push(k, done)
            elif self.memory[self.pairs[k]][contact_state.SLIP] != 0.0:
                self.opened += 1
                i, j = self.pairs[k]
                lost, damped = let_go(self.S, i, j, self.memory[i, j], self.laws, self.physics.rolling > 0, world)
                self.lost, total.work, total.damped = self.lost + lost, total.work + lost, total.damped + damped
                self.lose(k, lost)
        return total

    def order(self):
        return range(len(self.pairs))

    def give(self, b, force, torque, work, slip):
        act(self.B[b], force, torque)
        self.B[b][body.FRICTION_WORK] += work
        self.B[b][body.SLIP_DISTANCE] += slip

    def lose(self, k, lost):
        i, j = self.pairs[k]
        self.B[self.body[i]][body.FRICTION_WORK] += lost if j < 0 else 0.5 * lost
        if j >= 0:
            self.B[self.body[j]][body.FRICTION_WORK] += 0.5 * lost

    def meet(self, k, world):
        """What the closed contact in slot k does; its memory and its record are brought up to date."""
        (i, j), memory = self.pairs[k], self.memory[self.pairs[k]]
        self.closed += memory[contact_state.SLIP] == 0.0
        done = interact(self.S, i, j, self.kinds[k], memory, self.laws, self.physics.rolling > 0, world)
        self.records[i, j] = write_record(self.S, i, j, done, world, self.physics.rolling)
        return done

    def push(self, k, done):
        i, j = self.pairs[k]
        here, force, slip = self.body[i], done.force, done.answer.slip
        if j < 0:
            self.give(here, force, self.about(i, done.torque, force), done.answer.work, slip)
            self.B[here][UPPER_PUSH] += 0.0 if j == -1 else force[2]
            return
        there, against = self.body[j], added((0.0, 0.0, 0.0), force, -1.0)
        torque, back = done.torque, done.back
        if len(self.S) > len(self.B):
            torque, back = self.about(i, torque, force), self.about(j, back, against)
        share = 0.5 * done.answer.work
        self.give(here, force, torque, share, slip)
        self.give(there, against, back, share, slip)

    def about(self, s, torque, force):
        return added(torque, cross(three(self.S[s], sphere.ARM), force))

    def close(self, b, time, dt):
        """The closing half kick of a body and its effects; returns the powers of the effects along the axes, W."""
        B, powers = self.B[b], [0.0, 0.0, 0.0]
        kick(B, three(B, body.FORCE), three(B, body.TORQUE), dt)
        see_spin(B)
        if self.physics.has_effects:
            acting = self.effects.on(B, time, dt)
            force, torque = three(acting, 0), three(acting, 3)
            B[EFFECT_FORCE : EFFECT_FORCE + 3], B[EFFECT_TORQUE : EFFECT_TORQUE + 3] = force, torque
            kick(B, force, torque, dt)
            see_spin(B)
            act(B, force, torque)
            powers = [force[k] * B[body.VELOCITY + k] + torque[k] * B[body.SPIN + k] for k in range(3)]
        return powers

    def total(self, powers):
        return sum(power for body in powers for power in body)

    def account(self, spent, effects, patches, v, dt):
        A, half, upper, lower = self.A, 0.5 * dt, spent.upper, spent.lower
        load, damping = patches[0] + patches[1], patches[2]
        A[run_totals.FRICTION_WORK] += spent.work
        A[run_totals.DAMPING_WORK] += spent.damped + half * (A[run_totals.PATCH_POWER] + damping)
        A[run_totals.EFFECT_WORK] += half * (A[run_totals.EFFECT_POWER] + effects)
        drag = -half * ((A[run_totals.UPPER_FORCE] + upper[0]) * v[0] + (A[run_totals.UPPER_FORCE + 1] + upper[1]) * v[1])
        plate = drag + half * (A[run_totals.LOAD_POWER] + load)
        A[run_totals.DRAG_WORK] += drag
        A[run_totals.PLATE_WORK] += plate
        A[run_totals.PLATE_WORK_SIZE] += abs(plate)
        for k in range(3):
            A[run_totals.UPPER_IMPULSE + k] += half * (A[run_totals.UPPER_FORCE + k] + upper[k])
            A[run_totals.LOWER_IMPULSE + k] += half * (A[run_totals.LOWER_FORCE + k] + lower[k])
        A[run_totals.UPPER_FORCE3], A[run_totals.LOWER_FORCE3] = upper, lower
        A[run_totals.EFFECT_POWER], A[run_totals.PATCH_POWER], A[run_totals.LOAD_POWER] = effects, damping, load
        A[run_totals.STORED_NORMAL], A[run_totals.STORED_TANGENTIAL] = spent.stored_n, spent.stored_t
        speed = math.sqrt(v[0] * v[0] + v[1] * v[1])
        for column, change in (
            (run_totals.TIME, dt), (run_totals.ELAPSED, dt), (run_totals.SHIFT_X, v[0] * dt), (run_totals.SHIFT_Y, v[1] * dt),
            (run_totals.DISTANCE, speed * dt), (run_totals.STEPS, 1.0),
        ):  # fmt: skip
            A[column] += change
        A[run_totals.PLATE_SPEED] = speed
        steps = int(A[run_totals.STEPS]) % 16
        A[run_totals.BEHIND] = dt * (steps - sum(weight for k, weight in TAKEN.items() if k < steps))
        if speed > 0.0:
            A[run_totals.HEADING], A[run_totals.HEADING + 1] = v[0] / speed, v[1] / speed


def pairs_of(slots):
    return list(zip(slots.own.tolist(), slots.partner.tolist(), strict=True))
