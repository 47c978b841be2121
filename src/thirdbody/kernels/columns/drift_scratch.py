"""Fields of a chunk of bodies in the drift pass, structure of arrays (stride: bodies per chunk).

First the columns of `body`; then those of `body_extra` that all scenes have; then the orientation, what spheres need of the end
of the step, the rotation matrix and the longest path.
"""

from thirdbody.kernels.columns import body, body_extra, sphere
from thirdbody.kernels.columns.table import Table

table = Table("scratch", "a chunk of bodies")

table.skip(body.WIDTH)
MID_SPIN, MID_SPIN3 = table.vector("mid_spin", 3, "rad/s", "angular velocity in the middle of the step", at=sphere.MID_SPIN)
ANGULAR_MOMENTUM, ANGULAR_MOMENTUM3 = table.vector(
    "angular_momentum", 3, "kg m2/s", "angular momentum, world axes", at=body.WIDTH + body_extra.ANGULAR_MOMENTUM
)
LONGEST_ARM = table.scalar("longest_arm", "m", "of the farthest sphere", at=body.WIDTH + body_extra.LONGEST_ARM)
INERTIA, INERTIA3 = table.vector("inertia", 3, "kg m2", "principal moments", at=body.WIDTH + body_extra.INERTIA)
table.skip(1)
QUATERNION, QUATERNION4 = table.vector("quaternion", 4, "", "orientation w, x, y, z; body to world")
END_VELOCITY, END_VELOCITY3 = table.vector("end_velocity", 3, "m/s", "predicted for the end of the step")
END_SPIN, END_SPIN3 = table.vector("end_spin", 3, "rad/s", "predicted for its end")
MATRIX, MATRIX9 = table.vector("matrix", 9, "", "rotation matrix, body to world, row by row")
PATH = table.scalar("path", "m", "longest path of a point in the step")
WIDTH = table.width
