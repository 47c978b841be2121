"""Mindlin's no-slip stiffness with Coulomb's limit, and a memory that cycles of the load do not wear out."""

from __future__ import annotations

from typing import NamedTuple

from .contract import Law, Options, Pair, Tangential, kernel
from .elasticity import e_star, g_star
from .friction import MEMORY, friction_tangent, keeps, stretched, stretched_tangent


class MindlinParameters(NamedTuple):
    """Effective shear modulus (the paper's G*), Pa; friction; ratio of the moduli E*/G*; what is kept of a non-uniform field."""

    g_star: float
    mu: float
    kappa: float  # mu E*/G*
    keeps: float  # 1; 0: memory = "rescaled"


@kernel
def mindlin(c, load, p, h):
    """T -= 2 G* a ds, scaled back onto mu N; T and the energy U are remembered (`stretched`).

    Loss of contact area releases force and energy of the area that is lost (Thornton and Randall 1988; Walton and Braun 1986);
    a stored displacement instead makes energy (Elata and Berryman 1996). The spring belongs to the patch, not to the material
    under it: a spot that rolls on keeps its tangential force, where in truth fresh material enters the patch unloaded and the
    force dies within about two contact radii of travel.
    """
    limit = p.mu * load.force
    t = stretched(c.slip_x, c.slip_y, h, 2.0 * p.g_star * load.contact_radius, limit, p.keeps)
    return Tangential(t.x, t.y, limit, p.kappa * c.overlap, t.slip, t.stored, t.dissipated), (t.x, t.y, t.stored)


@kernel
def mindlin_tangent(c, load, p, h):
    """Consistent tangent of one step: dT/d(slip) and dT/d(overlap), with the load's own stiffness in the limit."""
    stiffness, rate = 2.0 * p.g_star * load.contact_radius, p.g_star * c.radius / max(load.contact_radius, 1e-300)
    x, y, x_rate, y_rate = stretched_tangent(c.slip_x, c.slip_y, h, stiffness, rate)
    return friction_tangent(x, y, p.mu * load.force, p.mu * load.stiffness, stiffness, x_rate, y_rate)


def mix_mindlin(pair: Pair, options: Options) -> MindlinParameters:
    """G*, friction and kappa = mu E*/G* (Willert, Eqs. 13, 14)."""
    g = g_star(pair.a, pair.b)
    return MindlinParameters(g, pair.friction, pair.friction * e_star(pair.a, pair.b) / g, keeps(options))


MINDLIN = Law(
    name="mindlin",
    stage="tangential",
    kernel=mindlin,
    tangent=mindlin_tangent,
    parameters=MindlinParameters,
    mix=mix_mindlin,
    history=("force_x", "force_y", "energy"),
    options=(MEMORY,),
    source="Mindlin 1949; loss of area: Walton and Braun 1986, Thornton and Randall 1988; memory: thirdbody.laws.friction",
)
