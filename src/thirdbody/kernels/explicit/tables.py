"""Tables of the explicit steps."""

from thirdbody.kernels.table import Table, number, skip, vector
from thirdbody.kernels.tables import body, body_extra, sphere

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

# Motion of a chunk of bodies in a step: extrema, guards, power of effects.
chunk_motion = Table(
    "moves",
    "a chunk of bodies",
    max_path=number("m", "longest path of a point of a body in the step"),
    max_travel=number("", "largest path over the radius"),
    body=number("", "its body"),
    bad_body=number("", "the last body that is not finite, plus 1; 0: none"),
    left_body=number("", "the last body that left the domain, plus 1; 0: none"),
    effect_power=number("W", "power of body effects"),
)

# Stiffness and damping of a contact, for the bound of the time step.
contact_stiffness = Table(
    "stiffnesses",
    "a contact",
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
