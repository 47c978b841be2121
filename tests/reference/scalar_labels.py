"""What a labeller sees of every body in a sampled step, in Python floats; the labeller itself is the compiled one."""

from __future__ import annotations

from typing import Any

import numpy as np
from scalar_bodies import E_EF, E_ET

from thirdbody.kernels import layout as at

FAR = 67108864.0
"""2^26: spheres that a name of a contact can tell apart."""


def look(reference: Any, v: tuple[float, float]) -> None:
    """Let the labeller observe all bodies of a reference; `v` is the mean velocity of the upper plate."""
    behind = reference.columns - 2 * reference.physics.contact_memory
    speed = (v[0] * v[0] + v[1] * v[1]) ** 0.5
    for b, B in enumerate(reference.B):
        seen = [entry for entry in reference.slots(b) if reference.memory[reference.pairs[entry[0]]][at.H_ON] != 0.0]
        # its memory per contact: that of the owner's body, then that of the partner's
        parts = [behind + (reference.physics.contact_memory if sign < 0.0 else 0) for _, sign in seen]
        pairs = [reference.pairs[k] for k, _ in seen]
        C = np.zeros((len(seen), at.C_MEMORY + reference.physics.contact_memory))
        for n, (pair, (_, sign), part) in enumerate(zip(pairs, seen, parts, strict=True)):
            C[n, : at.C_MEMORY] = contact_row(pair, sign, reference.memory[pair], reference.records[pair])
            C[n, at.C_MEMORY :] = reference.memory[pair][part : part + reference.physics.contact_memory]
        memory = np.array(reference.M[b])
        reference.physics.observe(C, len(seen), body_row(B, reference.A, reference.drag, speed), memory)
        reference.M[b] = memory.tolist()
        for n, (pair, part) in enumerate(zip(pairs, parts, strict=True)):
            reference.memory[pair][part : part + reference.physics.contact_memory] = C[n, at.C_MEMORY :].tolist()


def contact_row(pair: tuple[int, int], sign: float, H: list[float], R: list[float]) -> np.ndarray:
    """A contact as its owner (sign 1) or its partner (-1) sees it; the labeller's own memory is left out."""
    C = [0.0] * at.C_MEMORY
    owner, (i, j) = sign > 0.0, pair
    C[at.C_PARTNER] = at.DEBRIS if j >= 0 else (at.LOWER if j == -1 else at.UPPER)
    of_owner, of_partner = (at.R_POINT, at.R_VJ, at.R_CURVATURE), (at.R_POINT_J, at.R_VI, at.R_CURVATURE_J)
    point, velocity, curvature = of_owner if owner else of_partner
    C[at.C_POINT : at.C_POINT + 3] = R[point : point + 3]
    C[at.C_V : at.C_V + 3] = R[velocity : velocity + 3]
    C[at.C_NORMAL : at.C_NORMAL + 3] = [sign * n for n in R[at.R_N : at.R_N + 3]]
    C[at.C_T : at.C_T + 3] = [sign * t for t in R[at.R_T : at.R_T + 3]]
    C[at.C_CURVATURE], C[at.C_SLIP] = R[curvature], H[at.H_SLIP] - at.H_LEAST
    for to, column in ((at.C_A, at.R_A), (at.C_OVERLAP, at.R_OVERLAP), (at.C_FN, at.R_FN), (at.C_LOAD, at.R_LOAD),
                       (at.C_LIMIT, at.R_LIMIT), (at.C_CRITICAL, at.R_CRITICAL)):  # fmt: skip
        C[to] = R[column]
    here, there = (i, max(j, -2)) if owner else (j, i)
    C[at.C_IDENTITY] = here * FAR + there + 3.0
    return np.array(C)


def body_row(B: list[float], A: list[float], drag: tuple[float, float], speed: float) -> np.ndarray:
    """The motion of a body and of the plates."""
    O = [0.0] * at.O_COLS  # noqa: E741
    O[at.O_MASS] = B[at.B_MASS]
    for to, column in ((at.O_X, at.B_X), (at.O_V, at.B_V), (at.O_W, at.B_W), (at.O_F, at.B_F), (at.O_T, at.B_T),
                       (at.O_MA, at.B_F), (at.O_LDOT, at.B_T), (at.O_EF, E_EF), (at.O_ET, E_ET)):  # fmt: skip
        O[to : to + 3] = B[column : column + 3] if column < len(B) else (0.0, 0.0, 0.0)
    O[at.O_Q : at.O_Q + 4] = B[at.B_Q : at.B_Q + 4]
    O[at.O_ELAPSED], O[at.O_SHIFT], O[at.O_SHIFT + 1] = A[at.A_ELAPSED], A[at.A_DX], A[at.A_DY]
    heading = A[at.A_HEADING], A[at.A_HEADING + 1]
    O[at.O_DRAG : at.O_DRAG + 2] = drag if heading == (0.0, 0.0) else heading
    O[at.O_SPEED] = speed
    return np.array(O)
