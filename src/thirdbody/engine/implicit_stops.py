"""What stops or limits an implicit run, in words, and the guard of the energy that its integrator creates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from thirdbody.engine.guards import name_of, partner_of
from thirdbody.engine.state import Array, State
from thirdbody.kernels.implicit.control import CAUSES, OF_A_BODY, WORDS, Stop
from thirdbody.kernels.implicit.tables import step_memory, step_settings
from thirdbody.kernels.tables import body, body_extra, domain, patch, run_totals
from thirdbody.kernels.tile import TILE

if TYPE_CHECKING:
    from thirdbody.engine.implicit import Implicit

CREATED_ENERGY_GUARD = 0.1
"""Largest created energy over the exchanged energy, for each body and for all. Valid runs stay below 0.05 for a single body at
the very start, and below 0.005 later."""

NEGLIGIBLE = 0.01
"""Exchanged energy below which that of a body is no scale, as a fraction of the mean of all bodies. The tolerance of a step is a
length, which does not resolve the weak impacts of bodies that carry no load between rough plates: they may create a tenth of what
they exchange, a millionth of what a loaded body exchanges."""


def causes(memory: Array) -> Array:
    """Return the number of steps of each body limited by each cause: a view of these columns."""
    return memory[:, step_memory.LIMITED : step_memory.LIMITED + len(CAUSES)]


def limited_by(memory: Array) -> dict[str, int]:
    """Return the number of steps limited by each cause, most frequent first, without zeros."""
    counts = causes(memory).sum(axis=0)
    return {CAUSES[k]: int(counts[k]) for k in np.argsort(-counts, kind="stable") if counts[k] > 0.0}


def limiting_body(memory: Array, order: np.ndarray) -> dict[str, int]:
    """Return the body (number in the scene) that has limited most steps, and how many."""
    steps = memory[:, step_memory.LIMITED : step_memory.LIMITED + OF_A_BODY].sum(axis=1)
    body = int(np.argmax(steps))
    return {"body": int(order[body]), "steps": int(steps[body])}


def in_words(steps: Array, order: np.ndarray) -> str:
    """Return as text the most frequent cause, its fraction, the body most affected; "" without steps.

    `steps`: those of each body limited by each cause (`causes`).
    """
    counts = steps.sum(axis=0)
    if not counts.sum() > 0.0:
        return ""
    k = int(np.argmax(counts))
    fraction = f"{100.0 * counts[k] / counts.sum():.0f} % of steps limited by {WORDS[k]}"
    if len(steps) == 1 or k >= OF_A_BODY:
        return fraction
    return f"{fraction}, most of them of body {order[int(np.argmax(steps[:, k]))]}"


def created_fractions(totals: Array, stored: Array, whole: Array) -> tuple[Array, float]:
    """Return the energy created by the integrator (negative: lost) over the exchanged energy: of each body (n,), and of all.

    `totals`: (n, run_totals.WIDTH); `stored`: kinetic and elastic energy (n,) [J]; `whole`: totals of the run, with those of a
    common plate. The exchanged energy of a body is at least NEGLIGIBLE times the mean.
    """
    scales, all_scale = exchanged_energy(totals, stored), float(exchanged_energy(whole[None], stored.sum())[0])
    if not all_scale > 0.0:
        return np.zeros(len(totals)), 0.0
    scales = np.maximum(scales, NEGLIGIBLE * all_scale / len(totals))
    return -totals[:, run_totals.NUMERICAL_LOSS] / scales, -float(whole[run_totals.NUMERICAL_LOSS]) / all_scale


def exchanged_energy(totals: Array, stored: Array) -> Array:
    """Return the largest (n,) [J] of: sum of |plate work increments|; |work of effects|; dissipated plus `stored` energy."""
    spent = totals[:, run_totals.FRICTION_WORK] + totals[:, run_totals.DAMPING_WORK] + stored
    return np.maximum(np.maximum(totals[:, run_totals.PLATE_WORK_SIZE], np.abs(totals[:, run_totals.EFFECT_WORK])), spent)


def body_energies(state: State, stored: Array) -> Array:
    """Return kinetic energy of each body and its free patch plus elastic energy `stored`, all (n,) [J]."""
    B, E, P = state.B, state.E, state.P[state.patch]
    kinetic = B[:, body.MASS] * np.sum(B[:, body.VELOCITY3] ** 2, axis=1)
    kinetic += np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3], axis=1)
    kinetic += P[:, patch.FREE] * P[:, patch.MASS] * P[:, patch.VELOCITY] ** 2
    return 0.5 * float(state.inertial) * kinetic + stored


def explain(integrator: Implicit, body: int) -> str:
    """Return what stopped a body, when, and what can be done."""
    s, totals = integrator.state, integrator.totals[body]
    code, when = int(integrator.memory[body, step_memory.CODE]), f"stopped at t = {totals[run_totals.TIME]:.6g} s"
    who = name_of(body, s)
    if code == Stop.OVERLAP:
        slot = int(integrator.memory[body, step_memory.SLOT])
        own, partner = int(s.slots.own[slot]), int(s.slots.partner[slot])
        radius = s.spheres.radius[own] if partner < 0 else min(s.spheres.radius[own], s.spheres.radius[partner])
        ratio, limit = s.slots.records.overlap[slot] / radius, s.D[domain.OVERLAP_GUARD]
        text = f"sinks into {partner_of(s, slot, body)} by {ratio:.2f} of the radius (guard: {limit:g})"
        return f"{when}: {who} {text}; a lower load is needed"
    if code == Stop.LEFT:
        return f"{when}: {who} left the domain"
    if code == Stop.CROWDED:
        return f"{when}: {who} has more than {TILE} loaded spots, which the implicit integrator cannot hold"
    if code == Stop.BAD_BODY:
        return f"{when}: the position of body {s.order[body]} is not a number"
    slots, loaded = s.slots, []
    for entry in slots.incidence[slots.edges[body] : slots.edges[body + 1]]:
        k = entry >> 1
        if slots.histories.slip[k] > 0.0:
            sphere = int((slots.partner[k] if entry & 1 else slots.own[k]) - s.start[body])
            force, shear = slots.records.normal_force[k], float(np.linalg.norm(slots.records.tangential_force[k]))
            loaded.append(f"sphere {sphere} on {partner_of(s, k, body)} with N = {force:.3g} N, T = {shear:.3g} N")
    shortest, spots = integrator.settings[step_settings.SHORTEST], "; ".join(loaded) or "none"
    return f"{when}: no step of {who} could be solved, down to {shortest:.2g} s; its loaded spots: {spots}"
