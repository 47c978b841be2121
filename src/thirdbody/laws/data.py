"""What kernels of laws and effects receive and return: named tuples, SI units. Signs are those of `laws.contract`."""

from typing import NamedTuple

FULL, EXPLICIT, IMPLICIT = 0.0, 1.0, 2.0
"""Code of the integrator, the last parameter of each pair where a force jumps at touch: outside steps, in explicit ones, in
implicit ones."""


class Contact(NamedTuple):
    """State of one contact, input of all laws.

    overlap : Overlap [m].
    radius : Effective radius of curvature [m], 1/R = 1/R_i + 1/R_j.
    mass : Effective mass [kg], 1/m = 1/m_i + 1/m_j.
    v_n : Separation speed, synchronised with the overlap [m/s].
    slip_x, slip_y : Slip during the step [m].
    v_x, v_y : Slip velocity, synchronised with the overlap [m/s].
    roll_x, roll_y : Travel of the contact area over both surfaces in the step, their mean [m]; 0 unless the law `rolls`.
    moved : Overlap gained in the step [m]; 0 where nothing moves, and unless the force of a law jumps (`Law.in_steps`).
    """

    overlap: float
    radius: float
    mass: float
    v_n: float
    slip_x: float
    slip_y: float
    v_x: float
    v_y: float
    roll_x: float
    roll_y: float
    moved: float = 0.0


class Normal(NamedTuple):
    """Result of a normal law.

    force : Force, positive in compression [N].
    contact_radius : Radius of the contact area [m].
    stored, dissipated : Elastic energy, and energy dissipated during this step [J].
    peak_pressure : Largest pressure in the contact area [Pa].
    squared_radius_rate : d(a^2)/dd of the contact radius a [m]: finite at first touch, where da/dd of a sphere is not.
    """

    force: float
    contact_radius: float
    stored: float
    dissipated: float
    peak_pressure: float
    squared_radius_rate: float


class Adhesion(NamedTuple):
    """Result of an adhesion law.

    force : Force, negative: attractive [N].
    stored : Energy, zero where the force begins: at first touch, or at minus the reach; negative in an adhesive well [J].
    """

    force: float
    stored: float


class Load(NamedTuple):
    """Result of the normal stages, input of the tangential ones.

    force : Load available to friction: elastic plus viscous, never negative [N].
    elastic : Force of the normal law only [N].
    contact_radius : Radius of the contact area [m].
    stiffness : dN/dd [N/m]; set only when a tangent is evaluated.
    squared_radius_rate : d(a^2)/dd [m], so da/dd = squared_radius_rate/(2 a); set only when a tangent is evaluated.
    """

    force: float
    elastic: float
    contact_radius: float
    stiffness: float
    squared_radius_rate: float


class Tangential(NamedTuple):
    """Result of a tangential law.

    x, y : Force on i [N].
    limit : Largest tangential force allowed by friction [N].
    critical : Displacement at which a virgin contact under this load slips throughout [m].
    slip : Irreversible slip during this step [m].
    stored, dissipated : Elastic energy, and energy dissipated during this step [J].
    """

    x: float
    y: float
    limit: float
    critical: float
    slip: float
    stored: float
    dissipated: float


class Turn(NamedTuple):
    """Rotation of i relative to j about the tangential axes of the contact frame, input of the rolling stage.

    x, y : Rotation during the step [rad].
    w_x, w_y : Its rate, synchronised with the overlap [rad/s].
    """

    x: float
    y: float
    w_x: float
    w_y: float


class Rolling(NamedTuple):
    """Result of a rolling law.

    x, y : Moment on i about the axes of the contact frame [N m].
    limit : Largest moment [N m].
    viscosity : Viscous moment per unit rolling rate, limited by the engine to the remaining moment [N m s].
    turn : Irreversible rotation during this step [rad].
    stored, dissipated : Elastic energy, and energy dissipated during this step [J].
    """

    x: float
    y: float
    limit: float
    viscosity: float
    turn: float
    stored: float
    dissipated: float


class Twist(NamedTuple):
    """Rotation of i relative to j about the normal, input of the twisting stage.

    angle : Rotation during the step [rad].
    rate : Its rate, synchronised with the overlap [rad/s].
    """

    angle: float
    rate: float


class Twisting(NamedTuple):
    """Result of a twisting law.

    moment : Moment on i about the normal [N m].
    limit : Largest moment [N m].
    viscosity : Viscous moment per unit rate, limited by the engine to the remaining moment [N m s].
    turn : Irreversible rotation during this step [rad].
    stored, dissipated : Elastic energy, and energy dissipated during this step [J].
    """

    moment: float
    limit: float
    viscosity: float
    turn: float
    stored: float
    dissipated: float


class Body(NamedTuple):
    """State of one body in world axes, input of body effects.

    mass : Mass [kg].
    x, y, z : Centre of mass [m].
    v_x, v_y, v_z : Its velocity [m/s].
    w_x, w_y, w_z : Angular velocity [rad/s].
    inertia : Mean principal moment of inertia [kg m2].
    time : Time [s].
    """

    mass: float
    x: float
    y: float
    z: float
    v_x: float
    v_y: float
    v_z: float
    w_x: float
    w_y: float
    w_z: float
    inertia: float
    time: float


class Wrench(NamedTuple):
    """Result of a body effect.

    f_x, f_y, f_z : Force [N].
    t_x, t_y, t_z : Torque about the centre of mass [N m].
    """

    f_x: float
    f_y: float
    f_z: float
    t_x: float
    t_y: float
    t_z: float
