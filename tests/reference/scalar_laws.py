"""The laws of a scene asked about one contact, and its effects about one body, as plain Python functions one after the other.

The engine's own module is generated text, compiled, for a tile of contacts. Here the kernels run as their authors wrote them
(`py_func`), put together as the contract says."""

import math
import struct
from dataclasses import make_dataclass
from typing import Any

import numpy as np
from scalar_bodies import INERTIA
from thirdbody.kernels.tables import body, contact_state
from thirdbody.laws.data import Body, Load, Wrench


def plain(function):
    return getattr(function, "py_func", function)


Answer = make_dataclass("Answer", (
    "normal", "x", "y", "load", "limit", "critical", "slip", "radius", "pressure", "stored_n", "stored_t", "work", "memory",
    "moment", "moment_limit", "twist", "twist_limit", "lost", "viscous",
))  # fmt: skip
"""What the laws say of one contact: forces on the owner in its frame, N, and the rest of the columns O_* and Q_*. `twist` is the
moment about the normal, `lost` the part of the work that is of friction, `viscous` the forces of the dashpots: normal, tangential
(2), moment (2), moment about the normal."""


class Laws:
    """The chain of a scene; `pairs` holds the parameters of all pairs of materials, one row after the other."""

    def __init__(self, laws, pairs):
        self.laws = laws
        self.pairs = pairs
        self.width = max(sum(len(law.parameters._fields) for law in laws), 1)
        self.rolls = any(law.rolls for law in laws)
        self.turns = any(law.stage in ("rolling", "twisting") for law in laws)
        names = [name for law in laws for name in law.memory()]
        stages = [law.stage for law in laws]
        springs = sum(stage in stages for stage in ("tangential", "rolling", "twisting"))
        self.many = len(names)
        # the energy of the springs: a law's own number, or one behind those of the laws
        self.stored = names.index("energy") if springs == 1 and "energy" in names else self.many
        self.retained = self.many + int(springs > 0 and self.stored == self.many)
        self.dashpots = 2 if self.turns else 1 if "damping" in stages or "tangential_damping" in stages else 0
        self.force = names.index("force_x") if "force_x" in names else None
        self.moment = names.index("moment_x") if "moment_x" in names else None
        self.twist = names.index("moment") if "moment" in names else None

    def split(self, row):
        """History of the laws, energy of the springs and forces of the dashpots in a row of H."""
        history, behind = row[contact_state.LAW : contact_state.LAW + self.many], contact_state.LAW + self.retained
        stored = row[contact_state.LAW + self.stored] if self.stored < self.retained else 0.0
        viscous = [force for one in row[behind : behind + self.dashpots] for force in unpack_triple(one)]
        return history, stored, (viscous + [0.0] * 6)[:6]

    def joined(self, answer):
        viscous = (pack_triple(answer.viscous[:3]), pack_triple(answer.viscous[3:]))[: self.dashpots]
        return [*answer.memory, *[answer.stored_t][: self.retained - self.many], *viscous]

    def friction_takes(self, stored, after, old, new, message, rotation):
        """What the mean of the forces at both ends of a step does beyond what the springs store more than before, J."""
        turn, twist = rotation
        moved = [(self.force, message.slip_x, message.slip_y), (self.moment, turn.x, turn.y)]
        for at_force, x, y in moved:
            if at_force is not None:
                stored -= 0.5 * ((old[at_force] + new[at_force]) * x + (old[at_force + 1] + new[at_force + 1]) * y)
        if self.twist is not None:
            stored -= 0.5 * (old[self.twist] + new[self.twist]) * twist.angle
        return max(stored - after, 0.0)

    def dashpots_take(self, old, new, apart, message, rotation):
        """What the mean of the dashpots' forces at both ends of a step takes while bodies part, slip and turn, J."""
        turn, twist = rotation
        moved = (apart, message.slip_x, message.slip_y, turn.x, turn.y, twist.angle)
        return max(-0.5 * sum((a + b) * x for a, b, x in zip(old, new, moved, strict=False)), 0.0)

    def request(self, contact, rotation, kind, memory):
        at_law, at_memory, row = 0, 0, self.pairs[kind * self.width : (kind + 1) * self.width]
        called: dict[str, Any] = {}
        pulls, new = [], []
        elastic = force = 0.0
        load = Load(0.0, 0.0, 0.0, 0.0, 0.0)
        # stages come in the order normal, adhesion, damping, tangential, its damping, rolling, twisting; adhesion adds at the
        # end, so that the tangential stages see the load without it
        for law in self.laws:
            p = law.parameters(*row[at_law : at_law + len(law.parameters._fields)])
            at_law += len(p)
            before = memory[at_memory : at_memory + len(law.memory())]
            at_memory += len(before)
            seen: tuple[Any, ...] = {
                "normal": (contact,),
                "adhesion": (contact, called.get("normal")),
                "damping": (contact, called.get("normal")),
                "tangential": (contact, load),
                "tangential_damping": (contact, load),
                "rolling": (contact, rotation[0], load),
                "twisting": (contact, rotation[1], load),
            }[law.stage]
            answer, after = forecast_of(law, seen, p, before)
            new += after
            called[law.stage] = answer
            if law.stage == "normal":
                elastic = force = answer.force
            elif law.stage == "adhesion":
                pulls.append(answer)
            elif law.stage == "damping":
                force = max(elastic + answer, 0.0)
            load = Load(force, elastic, called["normal"].contact_radius, 0.0, 0.0)
        return together(contact, rotation, load, called, pulls, new)


def pack_triple(numbers):
    """The power of two of the largest, and each as a whole multiple of 2^-15 of it in 17 bits."""
    power = math.frexp(max(map(abs, (*numbers, 1e-280))) * (1.0 + 2.0**-16))[1] - 1
    bits = power + 1023 << 52
    for number, place in zip(numbers, (34, 17, 0), strict=True):
        bits |= (round(math.ldexp(number, 15 - power)) & 0x1FFFF) << place
    return struct.unpack("<d", struct.pack("<q", bits))[0]


def unpack_triple(one):
    bits = struct.unpack("<q", struct.pack("<d", one))[0]
    fields, power = [bits >> place & 0x1FFFF for place in (34, 17, 0)], (bits >> 52) - 1023
    return [math.ldexp(field - (field >> 16 << 17), power - 15) for field in fields]


def forecast_of(law, seen, p, before):
    kernel, count = plain(law.kernel), len(law.history)
    if not before:
        return kernel(*seen, p), []
    if len(before) == count:
        answer, history = kernel(*seen, p, tuple(before))
        return answer, list(history)
    field = np.empty(len(before) - count)
    answer, history = kernel(*seen, p, tuple(before[:count]), np.array(before[count:]), field)
    return answer, [float(h) for h in history] + field.tolist()


def together(contact, rotation, load, called, pulls, memory):
    normal, (turn, twist) = called["normal"], rotation
    force, stored, work, lost = load.force, normal.stored, normal.dissipated, 0.0
    viscous = [load.force - load.elastic, 0.0, 0.0, 0.0, 0.0, 0.0]
    for pull in pulls:
        force += pull.force
        stored += pull.stored
    x, y, limit, critical, stored_t = 0.0, 0.0, 0.0, 0.0, 0.0
    slip = math.sqrt(contact.slip_x * contact.slip_x + contact.slip_y * contact.slip_y)
    if "tangential" in called:
        t = called["tangential"]
        x, y, limit, critical, slip, stored_t = t.x, t.y, t.limit, t.critical, t.slip, t.stored
        work, lost = work + t.dissipated, t.dissipated
        if "tangential_damping" in called:
            x, y, viscous[1:3] = fitted(x, y, called["tangential_damping"], contact.v_x, contact.v_y, limit)
    moment, moment_limit = (0.0, 0.0), 0.0
    if "rolling" in called:
        r = called["rolling"]
        m_x, m_y, viscous[3:5] = fitted(r.x, r.y, r.viscosity, turn.w_x, turn.w_y, r.limit)
        stored_t += r.stored
        work, lost = work + r.dissipated, lost + r.dissipated
        moment, moment_limit = (m_x, m_y), r.limit
    about, about_limit = 0.0, 0.0
    if "twisting" in called:
        w = called["twisting"]
        about, viscous[5] = within(w.moment, -w.viscosity * twist.rate, w.limit)
        stored_t += w.stored
        work, lost, about_limit = work + w.dissipated, lost + w.dissipated, w.limit
    return Answer(force, x, y, load.force, limit, critical, slip, normal.contact_radius, normal.peak_pressure, stored,
                  stored_t, work, memory, moment, moment_limit, about, about_limit, lost, viscous)  # fmt: skip


def within(moment, viscous, limit):
    taken = min(max(moment + viscous, -limit), limit) - moment
    return moment + taken, taken


def fitted(x, y, viscosity, v_x, v_y, limit):
    """(x, y) plus the viscous part, returned to the limit along its own direction; and what that adds to (x, y)."""
    d_x, d_y = -viscosity * v_x, -viscosity * v_y
    size, most = math.hypot(x + d_x, y + d_y), max(limit, math.hypot(x, y))
    back = most / size if size > most else 1.0
    added = back * d_x - (1.0 - back) * x, back * d_y - (1.0 - back) * y
    return x + added[0], y + added[1], added


class Effects:
    """Body effects with their parameters, one after the other; behind them the end of settling, s, if one asks for it."""

    def __init__(self, effects, parameters):
        self.effects, self.parameters, first = effects, [], 0
        for effect in effects:
            count = len(effect.parameters._fields)
            self.parameters.append(effect.parameters(*parameters[first : first + count]))
            first += count
        self.until = parameters[first] if any(effect.settling for effect in effects) else math.inf

    def on(self, B, time, dt):
        mean = (B[INERTIA] + B[INERTIA + 1] + B[INERTIA + 2]) / 3.0
        moving = [*B[body.VELOCITY3], *B[body.SPIN3]]
        pushed = [*B[body.FORCE3], *B[body.TORQUE3]]
        motion = Body(B[body.MASS], *B[body.POSITION3], *moving, mean, time)
        answers: list[Any] = [None] * len(self.effects)
        for k, effect in enumerate(self.effects):
            if not effect.sees_forces:
                answers[k] = plain(effect.kernel)(motion, self.parameters[k])
        first = [answer for answer in answers if answer is not None]
        for k, effect in enumerate(self.effects):
            if effect.sees_forces:
                # they see the body after the closing half kick of those that do not, and all forces but their own
                late = [moving[i] + 0.5 * dt / (mean if i > 2 else motion.mass) * summed(first, i, 0.0) for i in range(6)]
                total = Wrench(*(summed(first, i, pushed[i]) for i in range(6)))
                seen = Body(motion.mass, motion.x, motion.y, motion.z, *late, mean, time)
                answers[k] = plain(effect.kernel)(seen, total, self.parameters[k])
            if effect.settling and time >= self.until:
                answers[k] = Wrench(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        return [summed(answers[1:], i, answers[0][i]) for i in range(6)]


def summed(answers, component, start):
    for answer in answers:
        start += answer[component]
    return start
