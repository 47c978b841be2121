"""What kernels of laws and effects receive and return: named tuples, SI units. Signs are those of `laws.contract`."""

from collections import namedtuple

FULL, EXPLICIT, IMPLICIT = 0.0, 1.0, 2.0
"""Code of the integrator, the last parameter of each pair where a force jumps at touch: outside steps, in explicit ones, in
implicit ones."""


class Contact(namedtuple("Contact", "overlap radius mass v_n slip_x slip_y v_x v_y roll_x roll_y moved", defaults=(0.0,))):
    """State of one contact, input of all laws.

    overlap : Overlap [m].
    radius : Effective radius of curvature [m], 1/R = 1/R_i + 1/R_j.
    mass : Effective mass [kg], 1/m = 1/m_i + 1/m_j.
    v_n : Separation speed, synchronised with the overlap [m/s].
    slip_x, slip_y : Slip during the step [m].
    v_x, v_y : Slip velocity, synchronised with the overlap [m/s].
    roll_x, roll_y : Travel of the contact area over both surfaces in the step, their mean [m]; 0 unless the law `rolls`.
    moved : Overlap gained in the step [m]; 0 where nothing moves, and unless the force of a law jumps (`Law.in_steps`)."""


class Normal(namedtuple("Normal", "force contact_radius stored dissipated peak_pressure squared_radius_rate")):
    """Result of a normal law.

    force : Force, positive in compression [N].
    contact_radius : Radius of the contact area [m].
    stored, dissipated : Elastic energy, and energy dissipated during this step [J].
    peak_pressure : Largest pressure in the contact area [Pa].
    squared_radius_rate : d(a^2)/dd of the contact radius a [m]: finite at first touch, where da/dd of a sphere is not."""


class Adhesion(namedtuple("Adhesion", "force stored")):
    """Result of an adhesion law.

    force : Force, negative: attractive [N].
    stored : Energy, zero where the force begins: at first touch, or at minus the reach; negative in an adhesive well [J]."""


class Load(namedtuple("Load", "force elastic contact_radius stiffness squared_radius_rate")):
    """Result of the normal stages, input of the tangential ones.

    force : Load available to friction: elastic plus viscous, never negative [N].
    elastic : Force of the normal law only [N].
    contact_radius : Radius of the contact area [m].
    stiffness : dN/dd [N/m]; set only when a tangent is evaluated.
    squared_radius_rate : d(a^2)/dd [m], so da/dd = squared_radius_rate/(2 a); set only when a tangent is evaluated."""


class Tangential(namedtuple("Tangential", "x y limit critical slip stored dissipated")):
    """Result of a tangential law.

    x, y : Force on i [N].
    limit : Largest tangential force allowed by friction [N].
    critical : Displacement at which a virgin contact under this load slips throughout [m].
    slip : Irreversible slip during this step [m].
    stored, dissipated : Elastic energy, and energy dissipated during this step [J]."""


class Turn(namedtuple("Turn", "x y w_x w_y")):
    """Rotation of i relative to j about the tangential axes of the contact frame, input of the rolling stage.

    x, y : Rotation during the step [rad].
    w_x, w_y : Its rate, synchronised with the overlap [rad/s]."""


class Rolling(namedtuple("Rolling", "x y limit viscosity turn stored dissipated")):
    """Result of a rolling law.

    x, y : Moment on i about the axes of the contact frame [N m].
    limit : Largest moment [N m].
    viscosity : Viscous moment per unit rolling rate, limited by the engine to the remaining moment [N m s].
    turn : Irreversible rotation during this step [rad].
    stored, dissipated : Elastic energy, and energy dissipated during this step [J]."""


class Twist(namedtuple("Twist", "angle rate")):
    """Rotation of i relative to j about the normal, input of the twisting stage.

    angle : Rotation during the step [rad].
    rate : Its rate, synchronised with the overlap [rad/s]."""


class Twisting(namedtuple("Twisting", "moment limit viscosity turn stored dissipated")):
    """Result of a twisting law.

    moment : Moment on i about the normal [N m].
    limit : Largest moment [N m].
    viscosity : Viscous moment per unit rate, limited by the engine to the remaining moment [N m s].
    turn : Irreversible rotation during this step [rad].
    stored, dissipated : Elastic energy, and energy dissipated during this step [J]."""


class Body(namedtuple("Body", "mass x y z v_x v_y v_z w_x w_y w_z inertia time")):
    """State of one body in world axes, input of body effects.

    mass : Mass [kg].
    x, y, z : Centre of mass [m].
    v_x, v_y, v_z : Its velocity [m/s].
    w_x, w_y, w_z : Angular velocity [rad/s].
    inertia : Mean principal moment of inertia [kg m2].
    time : Time [s]."""


class Wrench(namedtuple("Wrench", "f_x f_y f_z t_x t_y t_z")):
    """Result of a body effect.

    f_x, f_y, f_z : Force [N].
    t_x, t_y, t_z : Torque about the centre of mass [N m]."""
