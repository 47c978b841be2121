"""Arguments of a step that both integrators share, by name (`kernels.arguments`): tables, numbers, addresses of functions."""

from typing import Any

import numpy as np

from thirdbody.engine.candidates import AllRows
from thirdbody.engine.state import Array, State
from thirdbody.jit.arguments import address
from thirdbody.kernels.arguments import EFFECTS, LAW, MEASURE, OBSERVE, OBSERVE_BODIES
from thirdbody.kernels.labels import observe_bodies
from thirdbody.kernels.tables import loaded_contact, sphere


def constant_arguments(state: State, drag: Array) -> dict[str, Any]:
    """Return those that no step and no search replaces. `drag`: unit vector of the prescribed motion of the upper plate."""
    s, physics, measures = state, state.physics, state.physics.measures
    (begin, size), (force, moment, twist) = physics.field, physics.force_columns
    return {
        "body": s.body, "start": s.start, "patch": s.patch, "offsets": s.offsets, "B": s.B, "E": s.E,
        "orientations": s.orientations, "P": s.P, "M": s.M, "D": s.D, "schedule": s.schedule, "first": s.first,
        "lower": s.lower_surface, "upper": s.upper_surface, "drag": drag, "pairs": physics.pairs,
        "interaction": physics.interaction, "effect_parameters": physics.effect_parameters,
        "n_history": len(physics.history), "field_begin": begin, "field_size": size, "rolling": physics.rolling,
        "force": force, "moment": moment, "twist": twist, "stored": physics.stored, "dashpots": physics.dashpots,
        "loss_column": physics.loss_column, "width": loaded_contact.MEMORY + physics.contact_memory,
        "has_effects": int(physics.has_effects), "labels": int(physics.labels), "law": address(physics.law, LAW),
        "effects": address(physics.effects, EFFECTS), "observe": address(physics.observe, OBSERVE),
        "observe_bodies": address(observe_bodies, OBSERVE_BODIES) if physics.labels else 0,
        "measured": measures.layout.width if measures else 0, "measure": address(measures.function, MEASURE) if measures else 0,
        "measure_parameters": measures.parameters if measures else np.zeros(1),
    }  # fmt: skip


def table_arguments(state: State) -> dict[str, Any]:
    """Return the tables that searches replace: of candidates and spheres; no rows where a body has them while it is advanced."""
    slots, rows = state.slots, state.slots.rows
    H, R = (rows.H, rows.R) if isinstance(rows, AllRows) else (np.zeros((0, width)) for width in rows.widths)
    S = np.zeros((0, sphere.WIDTH)) if state.sphere_table is None else state.sphere_table
    return {
        "own": slots.own, "partner": slots.partner, "edges": slots.edges, "incidence": slots.incidence, "S": S, "Q": slots.Q,
        "H": H, "R": R,
    }  # fmt: skip
