"""State of a body and its patch at the start of an implicit step, and coefficients of the step."""

from thirdbody.kernels.columns.table import Table

table = Table("Z", "a body")

POSITION, POSITION3 = table.vector("position", 3, "m", "centre of mass")
VELOCITY, VELOCITY3 = table.vector("velocity", 3, "m/s", "velocity")
QUATERNION, QUATERNION4 = table.vector("quaternion", 4, "", "orientation w, x, y, z; body to world")
ANGULAR_MOMENTUM, ANGULAR_MOMENTUM3 = table.vector("angular_momentum", 3, "kg m2/s", "angular momentum, world axes")
SPIN, SPIN3 = table.vector("spin", 3, "rad/s", "angular velocity")
PATCH_HEIGHT = table.scalar("patch_height", "m", "height of the patch")
PATCH_VELOCITY = table.scalar("patch_velocity", "m/s", "velocity of the patch, upwards")
ARM = table.scalar("arm", "m", "distance of the farthest point from the centre of mass")
PLATE_HEIGHT = table.scalar("plate_height", "m", "height of the plate at the end of the step")
NOW = table.scalar("now", "", "rate of change = (NOW change - BEFORE last change)/dt")
BEFORE = table.scalar("before", "", "see NOW")
PLATE_DISPLACEMENT = table.scalar("plate_displacement", "m", "displacement of the plate that a patch is sprung to")
TETHER_STIFFNESS = table.scalar("tether_stiffness", "N/m", "stiffness of the spring to the start position, without inertia")
MASS_FRACTION = table.scalar("mass_fraction", "", "fraction of its mass that a body without inertia keeps")
PATCH_DISPLACEMENT, PATCH_DISPLACEMENT2 = table.vector("patch_displacement", 2, "m", "displacement of the patch along x and y")
PATCH_LOAD = table.scalar("patch_load", "N", "load of the patch")
OLD_WEIGHT = table.scalar(
    "old_weight", "", "weight of the force at the start of the step in what the plate and friction take: a half, or 0"
)
WIDTH = table.width
