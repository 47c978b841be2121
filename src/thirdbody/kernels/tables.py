"""Tables of numbers that kernels share: C-contiguous float64, one row per thing; a kernel touches few cache lines.

Tables of one algorithm are declared elsewhere: `tile`, `step_tables`, `close_spots`.
"""

from thirdbody.kernels.table import Table, mark, number, skip, vector

LOWER, UPPER, DEBRIS = 0, 1, 2  # partners of a loaded contact
WALL = 3  # in outputs only: to laws and labels side walls are a part of the lower plate

ONLY_LOWER, EVERYTHING, ONLY_UPPER = -1, 0, 1
"""What a sphere can touch (`engine.state.State.side`): a spot of a given particle touches one plate only."""

CAN_STICK, CAN_SLIDE, NO_FORECAST = 1, 2, 4
"""Bits of the column `forecast` of a labeller: it can stick; it can slide along the drag; there is no forecast."""

# Spheres, columns in groups of four.
#
# Mid-step velocities give the displacement of the step; those predicted for its end feed the dashpots. Quantities that bodies
# have, too, are in the same columns (`body`): where every body is one sphere centred at its centre of mass, both are one table.
sphere = Table(
    "S",
    "a sphere",
    position=vector(3, "m", "centre"),
    radius=number("m", "radius"),
    mid_velocity=vector(3, "m/s", "velocity of the centre in the middle of the step"),
    mass=number("kg", "mass of its body"),
    mid_spin=vector(3, "rad/s", "angular velocity in the middle of the step"),
    _0=skip(1),
    end_velocity=vector(3, "m/s", "velocity of the centre predicted for the end of the step"),
    _1=skip(1),
    end_spin=vector(3, "rad/s", "angular velocity predicted for the end of the step"),
    _2=skip(1),
    arm=vector(3, "m", "centre from the centre of mass of its body, world axes; only in a table of its own"),
    _3=skip(1),
)
sphere.X, sphere.Y, sphere.Z = range(sphere.POSITION, sphere.POSITION + 3)

# Bodies, columns in groups of four: 160 bytes, all that a single-sphere body needs in a step.
#
# Where bodies and spheres are one table, force and torque are in the columns of the velocities predicted for the end of the step:
# the contacts need these, and from then on the next step needs what the contacts have summed (`body_force`).
body = Table(
    "B",
    "a body",
    position=vector(3, "m", "centre of mass", at=sphere.POSITION),
    velocity=vector(3, "m/s", "velocity: of now when synchronised, of mid-step inside a step", at=sphere.MID_VELOCITY),
    mass=number("kg", "mass", at=sphere.MASS),
    spin=vector(3, "rad/s", "angular velocity: of a single sphere as the velocity, else for output", at=sphere.MID_SPIN),
    sphere_inertia=number("kg m2", "moment of inertia of a single-sphere body; 0: not one"),
    force=vector(3, "N", "total force at the end of the last step", at=sphere.END_VELOCITY),
    friction_work=number("J", "friction work since the start; behind the force, to be summed with it"),
    torque=vector(3, "N m", "total torque at the end of the last step", at=sphere.END_SPIN),
    slip_distance=number("m", "slip of all its contacts since the start; behind the torque"),
)

# Bodies: quantities that a single-sphere body needs in few steps only; without effects and normal losses one cache line.
body_extra = Table(
    "E",
    "a body",
    angular_momentum=vector(3, "kg m2/s", "world axes: as the velocity, but of a single sphere where output needs it"),
    longest_arm=number("m", "distance of the farthest centre of a sphere from the centre of mass"),
    inertia=vector(3, "kg m2", "principal moments of inertia"),
    upper_push=number("N", "force of the upper plate on the body, upwards; a patch feels it"),
    width_without_effects=mark(),
    effect_force=vector(3, "N", "force of body effects; only in scenes that have some"),
    normal_loss=number("J", "dissipated by a normal law: flow, necks; only in scenes with one that does"),
    effect_torque=vector(3, "N m", "torque of body effects; only in scenes that have some"),
    _0=skip(1),
)

orientation = Table("orientations", "a body", quaternion=vector(4, "", "orientation w, x, y, z; body to world"))

search_pose = Table(
    "X0", "a body at the last search", position=vector(3, "m", "centre of mass"), quaternion=vector(4, "", "its orientation")
)

# Patches of the upper plate: one per body, or one for a rigid plate; on a foundation the last row is the common plate.
patch = Table(
    "P",
    "a patch",
    height=number("m", "height of its surface"),
    velocity=number("m/s", "velocity, upwards"),
    mass=number("kg", "mass"),
    damping=number("N s/m", "coefficient of its dashpot"),
    load=number("N", "load of now, downwards"),
    force=number("N", "force of debris and springs, upwards"),
    free=number("", "1: it moves under its load; 0: its motion is prescribed"),
    search_height=number("m", "height at the last search for neighbours"),
    spring=number("N/m", "stiffness of its spring to the common plate"),
    nominal_load=number("N", "load of which a schedule of loads gives the factor"),
    displacement=vector(2, "m", "displacement along x and y since the start"),
    direct_prefactor=number("N", "force of direct contact of the plates at zero gap; 0: none"),
    direct_length=number("m", "change of the gap that divides that force by e"),
    direct_friction=number("", "friction coefficient of direct contact"),
    first_load=number("N", "load at the start and its part of direct contact, where loads follow the position (`zone`)"),
    inside=number("", "there: 1: in the contact of the first bodies, 0: outside, -1: outside the domain for good"),
    outside_path=number("m", "there: path of the upper body since then"),
    outside_height=number("m", "there: height less the gap when its load vanished, more where a body has lifted it since"),
    edge=vector(2, "m", "there: position under the upper body: inside of now, outside where it left; NaN: it never was inside"),
)

zone = Table(
    "Z",
    "the contact of the first bodies, where loads follow the position",
    kind=number("", "`contact_zone.UNIFORM` and so on"),
    half_width=vector(2, "m", "half width along x and y; of a punch 0: endless"),
    edge=number("m", "length over which the pressure of a punch falls to zero"),
    radius=number("m", "radius of the upper body"),
    centre=vector(2, "m", "its middle at the start"),
    first=vector(2, "m", "of a map: position of its first node; its pressures, then its gaps, follow in the same row"),
    rate=vector(2, "1/m", "of a map: cells per length along x and y"),
    count=vector(2, "", "of a map: nodes along x and y"),
    scar_pressure=number("", "of a worn ball: its uniform pressure over the reference pressure"),
)

drive = Table(
    "Y",
    "lateral motion of the upper plate, where a base drives it through springs (`kernels.drive`)",
    stiffness=vector(2, "N/m", "of the springs along x and y; 0: none, the plate moves as the base"),
    mass=number("kg", "mass of the plate and its patches"),
    base=vector(2, "m", "displacement of the base"),
    base_velocity=vector(2, "m/s", "its mean velocity in the last step"),
    displacement=vector(2, "m", "displacement of the plate"),
    velocity=vector(2, "m/s", "its velocity; inside an explicit step that of mid-step"),
    force=vector(2, "N", "force of the springs on the plate"),
    push=vector(2, "N", "force of the debris on the plate"),
    slope=vector(4, "N/m", "implicit: estimated change of both forces with the displacement of the plate, by rows"),
)

domain = Table(
    "D",
    "the run: periodic lengths and limits",
    length_x=number("m", "periodic length; 0: unbounded; negative: walls at that distance"),
    length_y=number("m", "the same along y"),
    overlap_guard=number("", "largest overlap over the smaller radius"),
    travel_guard=number("", "largest displacement in a step over the radius"),
    skin=number("m", "distance beyond the reach up to which candidates are listed"),
    reach=number("m", "distance from touch at which bodies begin to act on each other"),
    floor=number("m", "height below which no body may be; -inf without a lower plate"),
    curved=vector(2, "", "of the lower and the upper plate: 1: curvature enters the effective radius"),
)

# History of a candidate: frame and slip, history of the laws, memory of the labeller.
#
# The laws have four columns or more. Most chains of laws need four numbers at most: a row is then one cache line.
contact_state = Table(
    "H",
    "a candidate contact",
    axis=vector(3, "", "first axis of its frame"),
    slip=number("m", "slip since it closed plus 1e-300 (CLOSED); 0 where it is open"),
    law=number("", "history of the laws, from here on"),
    _0=skip(3),
    min_width=mark(),
)
# slip of a contact that has not slipped yet [m], so that it differs from the 0 of an open one
contact_state.CLOSED = 1e-300

# Where spheres are closest to rough plates, updated in every step. No rows where both plates are flat.
#
# A sphere may have several contacts with a plate: one for each local minimum of the distance from its centre. Each keeps its row
# as long as it exists; a sphere has `plates.BASINS` rows per rough plate. The first says which rows have a minimum.
surface_contact = Table(
    "Q",
    "a candidate contact with a plate",
    offset=vector(2, "m", "closest point of the surface, along x and y from below the centre of the sphere"),
    start=vector(2, "m", "the same at the start of the last step"),
    start_distance=number("m", "implicit: the distance at the start of the step, or a lower bound of one too far to touch"),
    distance=number("m", "from the surface to the centre of the sphere; without a minimum: none is shorter"),
    minima=number("", "in the first row of a sphere: bits of the rows that have a minimum"),
    ended=number("", "in the first row of a sphere: bits of rows whose minimum ended in the last update, then of the one before"),
    normal=vector(3, "", "unit normal from the plate to the sphere, world axes"),
    radius=number("m", "effective radius of curvature"),
    normal_gradient=vector(6, "1/m", "change of the normal with the place of the sphere, symmetric: xx, yy, zz, xy, xz, yz"),
    gradient=vector(3, "1/m", "gradient of the logarithm of the effective radius, world axes"),
    gradient_change=vector(6, "1/m2", "implicit: its change with the place of the sphere, a symmetric tensor as above"),
    searched=vector(3, "m", "first row of a sphere: its centre at the last search for minima, in coordinates of the plate"),
    nearby=vector(3, "m", "scratch of the search: offset and distance of a minimum"),
    start_centre=vector(3, "m", "implicit, first row of a sphere: its centre at the start of the step, likewise"),
)

height_field = Table(
    "field",
    "a surface: head of its height field, in the same row",
    length_x=number("m", "period along x"),
    length_y=number("m", "period along y"),
    count_x=number("", "number of cells along x"),
    count_y=number("", "number of cells along y"),
    rate_x=number("1/m", "cells per length along x"),
    rate_y=number("1/m", "cells per length along y"),
    max_height=number("m", "no point is higher"),
    min_height=number("m", "no point is lower"),
    max_slope=number("", "no slope is steeper"),
    max_curvature=number("1/m", "the second derivatives of the height, as a matrix, have no larger norm"),
    levels=number("", "levels of the pyramid; the last one is a single block"),
    offset=vector(24, "", "where in the row each level of the pyramid begins, from level 1 on"),
)

record = Table(
    "R",
    "a candidate contact in an observed step",
    point=vector(3, "m", "contact point from the centre of mass of the owner's body"),
    partner_point=vector(3, "m", "the same from that of the partner's body"),
    normal=vector(3, "", "unit normal from partner to owner"),
    sphere_radius=number("m", "radius of the owner's sphere"),
    partner_radius=number("m", "radius of the partner's sphere; 0 for a plate"),
    contact_radius=number("m", "radius of the contact area"),
    overlap=number("m", "overlap"),
    normal_force=number("N", "total normal force"),
    load=number("N", "load that friction feels"),
    tangential_force=vector(3, "N", "tangential force on the owner"),
    friction_limit=number("N", "largest tangential force"),
    critical_slip=number("m", "displacement at which a virgin contact under this load slips throughout"),
    surface_velocity=vector(3, "m/s", "velocity of the owner's surface at the contact"),
    partner_velocity=vector(3, "m/s", "velocity of the partner's surface there"),
    stored_normal=number("J", "energy of the normal springs"),
    stored_tangential=number("J", "energy of the tangential and rolling springs"),
    effective_radius=number("m", "effective radius of curvature"),
    peak_pressure=number("Pa", "largest pressure in the contact area"),
    width=mark(),
    moment=vector(3, "N m", "moment on the owner; only in scenes with a rolling law"),
    moment_limit=number("N m", "largest moment; only in scenes with a rolling law"),
    rolling_width=mark(),
    twist_moment=number("N m", "moment on the owner about the normal; only in scenes with a twisting law"),
    twist_limit=number("N m", "largest moment about the normal; only in scenes with a twisting law"),
    twist_width=mark(),
)

remote_force = Table(
    "F",
    "a contact between two groups of bodies; zero where it is open, and once it is added",
    force=vector(3, "N", "force on the partner's body"),
    friction_work=number("J", "the partner's part of the friction work"),
    torque=vector(3, "N m", "torque on the partner's body"),
    slip=number("m", "the partner's part of the slip"),
    width_without_normal_loss=mark(),
    normal_loss=number("J", "the partner's part of what a normal law dissipates, as for bodies"),
    _0=skip(3),
)

observed_body = Table(
    "observed",
    "a body and its surroundings, as a labeller sees them",
    mass=number("kg", "mass"),
    position=vector(3, "m", "centre of mass"),
    velocity=vector(3, "m/s", "velocity"),
    quaternion=vector(4, "", "orientation w, x, y, z; body to world"),
    spin=vector(3, "rad/s", "angular velocity"),
    force=vector(3, "N", "sum of contact forces, weight and other effects, without inertia"),
    torque=vector(3, "N m", "sum of their moments about the centre of mass, without inertia"),
    effect_force=vector(3, "N", "force of body effects"),
    effect_torque=vector(3, "N m", "torque of body effects"),
    elapsed=number("s", "time since the last observation"),
    plate_shift=vector(2, "m", "displacement of the upper plate since then"),
    drag=vector(2, "", "unit vector of the drag of the upper plate"),
    plate_speed=number("m/s", "speed of the upper plate"),
)

loaded_contact = Table(
    "C",
    "a loaded contact of a body, as a labeller sees it, then the labeller's memory of it",
    partner=number("", "what it is with: LOWER, UPPER, DEBRIS"),
    point=vector(3, "m", "contact point from the centre of mass"),
    normal=vector(3, "", "unit normal from the partner to the body"),
    sphere_radius=number("m", "radius of the body's sphere"),
    contact_radius=number("m", "radius of the contact area"),
    overlap=number("m", "overlap"),
    normal_force=number("N", "total normal force"),
    load=number("N", "load that friction feels"),
    tangential_force=vector(3, "N", "tangential force on the body"),
    friction_limit=number("N", "largest tangential force"),
    critical_slip=number("m", "displacement at which a virgin contact under this load slips throughout"),
    slip=number("m", "slip since it closed"),
    partner_velocity=vector(3, "m/s", "velocity of the partner's surface there"),
    identity=number("", "number of the pair of surfaces, unique within the body"),
    memory=mark(),
)

run_totals = Table(
    "A",
    "the run, or each body: totals since the start, and powers of the last step for the trapezoidal rule",
    friction_work=number("J", "dissipated by friction"),
    damping_work=number("J", "dissipated by dashpots"),
    plate_work=number("J", "work of the plates"),
    drag_work=number("J", "the part of it that moves the upper plate sideways"),
    plate_work_size=number("J", "sum of the sizes of its increments"),
    effect_work=number("J", "work of body effects"),
    upper_impulse=vector(3, "N s", "impulse on the upper plate"),
    lower_impulse=vector(3, "N s", "impulse on the lower plate"),
    time=number("s", "time"),
    distance=number("m", "path of the upper plate relative to the lower one"),
    effect_power=number("W", "power of body effects"),
    patch_power=number("W", "power of debris on the patches"),
    load_power=number("W", "power of the loads"),
    upper_force=vector(3, "N", "force on the upper plate"),
    lower_force=vector(3, "N", "force on the lower plate"),
    shift_x=number("m", "displacement of the upper plate since the last observation, x"),
    shift_y=number("m", "the same, y"),
    steps=number("", "number of steps"),
    elapsed=number("s", "time since the last observation"),
    plate_speed=number("m/s", "speed of the upper plate in the last step"),
    heading=vector(2, "", "unit vector of the last relative motion of the plates"),
    numerical_loss=number("J", "what the integrator itself lost"),
    max_displacement=number("m", "no body is farther from where the last search saw it"),
    stored_normal=number("J", "energy of the normal springs of all contacts at the last observed step"),
    stored_tangential=number("J", "the same of the tangential and rolling springs"),
    direct_work=number("J", "dissipated by friction of direct contact of the plates"),
    direct_impulse=vector(3, "N s", "impulse of direct contact on the upper plate"),
    direct_force=vector(3, "N", "force of direct contact on the upper plate"),
    behind=number("s", "explicit: time by which the orientations of single spheres are behind; negative: ahead"),
)
