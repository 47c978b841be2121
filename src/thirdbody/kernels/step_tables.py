"""Tables of the steps of both integrators: of the implicit ones, then of the explicit ones."""

from thirdbody.kernels.table import Table, number, skip, vector
from thirdbody.kernels.tables import body, body_extra, sphere

step_settings = Table(
    "V",
    "the run: settings of the implicit integrator",
    tolerance=number("", "error of a step over the radius of the largest contact"),
    longest=number("m", "longest drag of a step"),
    shortest=number("s", "length of the shortest step that is tried"),
    inertial=number("", "1: bodies keep their momentum; 0: every step begins at rest"),
    expected_overlap=number("m", "overlap to expect"),
    growth=number("", "largest ratio of a step to the last one"),
    radii=number("", "longest drag of a step over the radius of the largest contact"),
    work=number("", "error of a step in the friction work, in parts of the energies in play"),
    common=number("", "1: all bodies carry one plate, the last patch"),
)

step_memory = Table(
    "T",
    "a body: state of the implicit integrator, in addition to its totals",
    next_dt=number("s", "length of the step to try next"),
    cuts=number("", "number of steps that were cut"),
    hard_steps=number("", "number of steps that were cut often"),
    tries=number("", "number of steps tried"),
    iterations=number("", "number of iterations of Newton's method"),
    stored=number("J", "elastic energy of its contacts"),
    contact_radius=number("m", "radius of its largest contact"),
    drag_radius=number("m", "radius that limits the drag of a step: of its largest contact, or that of a loaded body"),
    code=number("", "what stopped the body (`implicit.control.BodyStop`)"),
    slot=number("", "the contact that stopped it"),
    longest_drag=number("m", "longest drag of a step"),
    last_dt=number("s", "length of the last step; 0: start anew"),
    jumped=number("", "1: forces jumped in the last step, which started anew"),
    last_coordinates=vector(7, "m", "coordinates of the last step"),
    last_dv=vector(3, "m/s", "change of the velocity in the last step"),
    last_dl=vector(3, "kg m2/s", "change of the angular momentum in it"),
    last_dw=vector(3, "rad/s", "change of the angular velocity in it"),
    last_drise=number("m/s", "change of the velocity of the patch in it"),
    stiffness=number("N/m", "stiffness of the body"),
    limit=number("", "what limits the length of the next step (`implicit.control.StepLimit`)"),
    limited=vector(8, "", "how many steps each cause has limited"),
    max_energy=number("J", "largest energy that its contacts could store so far (`books`)"),
    candidates=number("", "number of candidates that can touch in this step: the first ones of the body"),
    last_force=vector(2, "N", "rough plates: change of the force on the upper plate along x and y in the last step"),
)

step_start = Table(
    "Z",
    "a body and its patch at the start of an implicit step, and coefficients of the step",
    position=vector(3, "m", "centre of mass"),
    velocity=vector(3, "m/s", "velocity"),
    quaternion=vector(4, "", "orientation w, x, y, z; body to world"),
    angular_momentum=vector(3, "kg m2/s", "angular momentum, world axes"),
    spin=vector(3, "rad/s", "angular velocity"),
    patch_height=number("m", "height of the patch"),
    patch_velocity=number("m/s", "velocity of the patch, upwards"),
    arm=number("m", "distance of the farthest point from the centre of mass"),
    plate_height=number("m", "height of the plate at the end of the step"),
    now=number("", "rate of change = (NOW change - LAST last change)/dt"),
    last=number("", "see NOW"),
    plate_displacement=number("m", "displacement of the plate that a patch is sprung to"),
    tether_stiffness=number("N/m", "stiffness of the spring to the start position, without inertia"),
    mass_fraction=number("", "fraction of its mass that a body without inertia keeps"),
    patch_displacement=vector(2, "m", "displacement of the patch along x and y"),
    patch_load=number("N", "load of the patch"),
    old_weight=number("", "weight of the force at the start of the step in what the plate and friction take: a half, or 0"),
)

step_contacts = Table(
    "diagnostics",
    "the contacts of a body, as the residual of an implicit step returns them",
    normal_force=number("N", "sum of the sizes of the normal forces"),
    max_overlap=number("m", "largest overlap"),
    max_radius=number("m", "largest radius of a contact area"),
    max_ratio=number("", "largest overlap over the radius of its sphere"),
    slot=number("", "its contact"),
)

body_solution = Table(
    "solutions",
    "a body under a common plate, solved for a given rise of the plate",
    solved=number("", "1: its equilibrium was found"),
    push=number("N", "force on the plate, upwards"),
    slope=number("N/m", "change of that force with the displacement of the plate, the body following"),
    pull=vector(2, "N", "force on the plate along x and y; only where springs drive it"),
    error=number("", "error of the step over what is allowed"),
    rotation=number("rad", "rotation in the step"),
    iterations=number("", "iterations of Newton's method"),
    crowded=number("", "1: it has more contacts than a tile holds"),
    lands=number("", "1: one of its contacts closed in the step"),
)

sphere_path = Table(
    "paths",
    "a sphere: path of its centre since the last search for islands",
    length=number("m", "length of the path, chord by chord"),
    low=vector(3, "m", "lower corner of a box around the path"),
    high=vector(3, "m", "upper corner of the box"),
)


# Forces on the bodies of a group in this step, while its contacts are summed: rows that the next groups use again.
body_force = Table(
    "forces",
    "a body of a group",
    force=vector(3, "N", "force so far"),
    friction_work=number("J", "friction work since the start"),
    torque=vector(3, "N m", "torque so far"),
    slip_distance=number("m", "slip since the start"),
)

# Sums over the contacts of a group: one row for contacts with plates, one for those between spheres.
contact_sums = Table(
    "sums",
    "the contacts of a group, with plates or between spheres",
    friction_work=number("J", "dissipated by friction in the step"),
    damping_work=number("J", "dissipated by dashpots in the step"),
    max_overlap=number("", "largest overlap over the smaller radius"),
    slot=number("", "its contact"),
    bad_slot=number("", "the last contact whose force is not finite, plus 1; 0: none"),
    stored_normal=number("J", "energy of the normal springs"),
    stored_tangential=number("J", "energy of the tangential and rolling springs"),
    _0=skip(1),
    upper_force=vector(3, "N", "force of the upper plate"),
    _1=skip(1),
    lower_force=vector(3, "N", "force of the lower plate"),
    _2=skip(1),
)

chunk_motion = Table(
    "moves",
    "a chunk of bodies in a step: extrema, guards, power of effects",
    max_path=number("m", "longest path of a point of a body in the step"),
    max_travel=number("", "largest path over the radius"),
    body=number("", "its body"),
    bad_body=number("", "the last body that is not finite, plus 1; 0: none"),
    left_body=number("", "the last body that left the domain, plus 1; 0: none"),
    effect_power=number("W", "power of body effects"),
)

contact_stiffness = Table(
    "stiffnesses",
    "a contact, for the bound of the time step",
    normal=vector(3, "", "unit normal from partner to owner"),
    _0=skip(1),
    stiffness=vector(3, "N/m, N m", "k_n - k_t, k_t, k_r"),
    count=number("", "how often it counts in the bound: 2 if the partner moves, too, else 1"),
    twist=number("N m", "k_w, rotation about the normal; replaces the count", at="count"),
    damping=vector(3, "N s/m, N m s", "the same of the dashpots"),
    patch=number("", "the patch that it presses; -1: none"),
    twist_damping=number("N m s", "k_w of the dashpots; replaces the patch", at="patch"),
)

# Fields of a chunk of bodies in the drift pass, structure of arrays (stride: bodies per chunk).
#
# First the columns of `body`; then those of `body_extra` that all scenes have; then the orientation, what spheres need of the end
# of the step, the rotation matrix and the longest path.
drift_scratch = Table(
    "scratch",
    "a chunk of bodies",
    _0=skip(body.WIDTH),
    mid_spin=vector(3, "rad/s", "angular velocity in the middle of the step", at=sphere.MID_SPIN),
    angular_momentum=vector(3, "kg m2/s", "angular momentum, world axes", at=body.WIDTH + body_extra.ANGULAR_MOMENTUM),
    longest_arm=number("m", "of the farthest sphere", at=body.WIDTH + body_extra.LONGEST_ARM),
    inertia=vector(3, "kg m2", "principal moments", at=body.WIDTH + body_extra.INERTIA),
    _1=skip(1),
    quaternion=vector(4, "", "orientation w, x, y, z; body to world"),
    end_velocity=vector(3, "m/s", "predicted for the end of the step"),
    end_spin=vector(3, "rad/s", "predicted for its end"),
    matrix=vector(9, "", "rotation matrix, body to world, row by row"),
    path=number("m", "longest path of a point in the step"),
)
