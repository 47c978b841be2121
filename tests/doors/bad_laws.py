"""Contact laws with one fault each, as people write them. The conformance suite must find every one."""

import dataclasses
import math
from typing import NamedTuple

from thirdbody import plugin
from thirdbody.plugin import HERTZ, HERTZ_DAMPING, MINDLIN, Law, LawFamily, Plugin, e_star, g_star, helper, kernel

mindlin_tangent = MINDLIN.tangent  # kernels call global functions


class Scale(NamedTuple):
    scale: float


class Shear(NamedTuple):
    g_star: float
    mu: float


def mix_scale(pair, _options):
    return Scale(e_star(pair.a, pair.b))


def mix_shear(pair, _options):
    return Shear(g_star(pair.a, pair.b), pair.friction)


@helper
def length(x, y):
    return math.sqrt(x * x + y * y)


@kernel
def stored_displacement(c, load, p, h):
    """F = k_t(d) xi, cut at mu N by shortening xi: pressed while sheared it makes energy."""
    k, limit = 2.0 * p.g_star * load.contact_radius, p.mu * load.force
    x, y = h[0] + c.slip_x, h[1] + c.slip_y
    size = k * length(x, y)
    back = limit / max(size, limit, 1e-300)
    slip = (1.0 - back) * length(x, y)
    x, y = back * x, back * y
    return plugin.Tangential(-k * x, -k * y, limit, 0.0, slip, 0.5 * k * (x * x + y * y), back * size * slip), (x, y)


@kernel
def beyond_friction(c, load, p):
    """Full sliding, with more force than it admits."""
    size, limit = max(length(c.slip_x, c.slip_y), 1e-300), p.mu * load.force
    force = 1.0001 * limit
    return plugin.Tangential(-force * c.slip_x / size, -force * c.slip_y / size, limit, 0.0, size, 0.0, force * size)


@kernel
def square_friction(c, load, p):
    """Each component cut on its own: the square that stands in the circle, but turned with the frame."""
    limit = p.mu * load.force
    edge, k = math.sqrt(0.5) * limit, math.sqrt(0.5) * limit / max(1e-6 * c.radius, 1e-300)
    x, y = -min(max(k * c.slip_x, -edge), edge), -min(max(k * c.slip_y, -edge), edge)
    return plugin.Tangential(x, y, limit, 0.0, 0.0, 0.0, -x * c.slip_x - y * c.slip_y)


@kernel
def swirl(c, load, p):
    """Part of the force always to the left of the slip: turns with the frame, but has a hand."""
    size, limit = max(length(c.slip_x, c.slip_y), 1e-300), p.mu * load.force
    e_x, e_y = c.slip_x / size, c.slip_y / size
    work = 0.8 * limit * length(c.slip_x, c.slip_y)
    return plugin.Tangential(-limit * (0.8 * e_x - 0.6 * e_y), -limit * (0.8 * e_y + 0.6 * e_x), limit, 0.0, size, 0.0, work)


@kernel
def lossless_ledger(c, load, p, h):
    """Full friction whose work appears nowhere."""
    size, limit = max(length(c.slip_x, c.slip_y), 1e-300), p.mu * load.force
    return plugin.Tangential(-limit * c.slip_x / size, -limit * c.slip_y / size, limit, 0.0, size, 0.0, 0.0), (0.0,)


@kernel
def unguarded(c, p):
    """Hertz with a = R d/sqrt(R d): 0/0 at first touch."""
    a = c.radius * c.overlap / math.sqrt(c.radius * c.overlap)
    force = 4.0 / 3.0 * p.scale * a * c.overlap
    return plugin.Normal(force, a, 0.4 * force * c.overlap, 0.0, 2.0 * p.scale * c.overlap / a, c.radius)


@kernel
def wound_up(c, p):
    """Softer on the way in than on the way out."""
    a = math.sqrt(c.radius * c.overlap)
    force = p.scale * a * c.overlap * (1.0 if c.v_n < 0.0 else 1.1)
    return plugin.Normal(force, a, 0.4 * p.scale * a * c.overlap * c.overlap, 0.0, p.scale, c.radius)


@kernel
def secant(c, p):
    """N/d, the secant stiffness, given as the tangent."""
    return 4.0 / 3.0 * p.e_star * math.sqrt(c.radius * c.overlap)


@kernel
def faint(c, p):
    """Hertz with the mean pressure given as the largest."""
    a = math.sqrt(c.radius * c.overlap)
    force = 4.0 / 3.0 * p.scale * a * c.overlap
    return plugin.Normal(force, a, 0.4 * force * c.overlap, 0.0, 0.999 * force / (math.pi * max(a * a, 1e-300)), c.radius)


@kernel
def fixed_area(c, p):
    """Hertz whose contact area does not grow, as it says."""
    a = math.sqrt(c.radius * c.overlap)
    force = 4.0 / 3.0 * p.scale * a * c.overlap
    return plugin.Normal(force, a, 0.4 * force * c.overlap, 0.0, p.scale, 0.0)


@kernel
def of_spheres(c, load, p, h):
    """The tangent of `mindlin` with da/dd = R/(2 a), whatever the normal law."""
    return mindlin_tangent(c, plugin.Load(load.force, load.elastic, load.contact_radius, load.stiffness, c.radius), p, h)


@kernel
def far_pull(c, n, p):
    """A pull that says it begins at 1e-3 radii, and acts from 1.2e-3 on."""
    inside = min(max(c.overlap + 1.2e-3 * c.radius, 0.0), 1.2e-3 * c.radius)
    pull = 1e-9 * p.scale * inside
    return plugin.Adhesion(-pull, -0.5 * pull * inside - pull * max(c.overlap, 0.0))


@kernel
def pushing_dashpot(c, n, p):
    return p.scale * math.sqrt(c.mass * n.contact_radius) * c.v_n


@kernel
def rocking_motor(c, turn, load, p, h):
    """M = k(d) theta, cut by shortening theta: pressed while it is bent it makes energy."""
    k, limit = p.g_star * load.contact_radius * c.radius * c.radius, p.mu * c.radius * load.force
    x, y = h[0] + turn.x, h[1] + turn.y
    size = k * length(x, y)
    back = limit / max(size, limit, 1e-300)
    turned = (1.0 - back) * length(x, y)
    x, y = back * x, back * y
    return plugin.Rolling(-k * x, -k * y, limit, 0.0, turned, 0.5 * k * (x * x + y * y), back * size * turned), (x, y)


def mix_of_first(pair, _options):
    return HERTZ.parameters(e_star(pair.a, pair.a))


def mix_not_finite(pair, _options):
    """Divides by what may be nothing, and hides it."""
    return Scale(1.0 / pair.friction if pair.friction else math.inf)


def tangential(name, law_kernel, history=()):
    return Law(name, "tangential", law_kernel, Shear, mix_shear, source="nobody", history=history)


LAWS = (
    tangential("stored_displacement", stored_displacement, ("x", "y")),
    tangential("beyond_friction", beyond_friction),
    tangential("square_friction", square_friction),
    tangential("swirl", swirl),
    tangential("lossless_ledger", lossless_ledger, ("nothing",)),
    Law("unguarded", "normal", unguarded, Scale, mix_scale, source="nobody"),
    Law("wound_up", "normal", wound_up, Scale, mix_scale, source="nobody"),
    dataclasses.replace(HERTZ, name="secant", tangent=secant),
    Law("faint", "normal", faint, Scale, mix_scale, source="nobody"),
    Law("fixed_area", "normal", fixed_area, Scale, mix_scale, source="nobody"),
    Law("far_pull", "adhesion", far_pull, Scale, mix_scale, source="nobody", reach=lambda pair, options, radius: 1e-3 * radius),
    Law("pushing_dashpot", "damping", pushing_dashpot, Scale, mix_scale, source="nobody"),
    dataclasses.replace(HERTZ, name="one_sided", mix=mix_of_first),
    Law("not_finite", "normal", wound_up, Scale, mix_not_finite, source="nobody"),
    dataclasses.replace(MINDLIN, name="unsourced", source=" "),
    dataclasses.replace(MINDLIN, name="misnamed", history=("energy", "force_y", "force_x")),
    dataclasses.replace(MINDLIN, name="of_spheres", tangent=of_spheres),
    Law("rocking_motor", "rolling", rocking_motor, Shear, mix_shear, source="nobody", history=("x", "y")),
    dataclasses.replace(HERTZ_DAMPING, name="misplaced", stage="dampening"),
)
PLUGIN = Plugin("bad_laws", families=(LawFamily("bad", {law.name: (law,) for law in LAWS}, "swirl"),))
