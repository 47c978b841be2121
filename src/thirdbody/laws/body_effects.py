"""Built-in body effects: gravity, and viscous damping of the motion. Inactive unless a scene names them."""

from typing import NamedTuple

from thirdbody.laws.contract import BodyEffect, Option, Options, kernel
from thirdbody.laws.kernel_data import Wrench


class GravityParameters(NamedTuple):
    """Acceleration [m/s2]."""

    g_x: float
    g_y: float
    g_z: float


@kernel
def gravity(b, p):
    """m g at the centre of mass."""
    return Wrench(b.mass * p.g_x, b.mass * p.g_y, b.mass * p.g_z, 0.0, 0.0, 0.0)


def mix_gravity(options: Options) -> GravityParameters:
    """Return the acceleration of the scene."""
    return GravityParameters(*options["acceleration"])


class ViscousParameters(NamedTuple):
    """Decay rate of the velocity [1/s]."""

    rate: float


@kernel
def viscous(b, p):
    """-rate m v and -rate I omega with the mean moment of inertia: a background that slows all motion equally."""
    f, t = -p.rate * b.mass, -p.rate * b.inertia
    return Wrench(f * b.v_x, f * b.v_y, f * b.v_z, t * b.w_x, t * b.w_y, t * b.w_z)


def mix_viscous(options: Options) -> ViscousParameters:
    """Return the rate of the scene."""
    return ViscousParameters(options["rate"])


GRAVITY = BodyEffect(
    name="gravity",
    kernel=gravity,
    parameters=GravityParameters,
    mix=mix_gravity,
    options=(Option("acceleration", "acceleration", None, size=3, doc="acceleration vector"),),
    source="Newton 1687",
)

DAMPING = BodyEffect(
    name="damping",
    kernel=viscous,
    parameters=ViscousParameters,
    mix=mix_viscous,
    options=(Option("rate", "rate", None, low=0.0, doc='rate at which velocities decay, such as "1e4 1/s"'),),
    source="linear (Stokes) drag with a uniform rate",
)
