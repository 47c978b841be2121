"""Fields of a chunk of bodies in the drift pass, structure of arrays (stride: bodies per chunk).

First the columns of `body`, with what spheres need in the columns that it has in `sphere`; then those of `body_extra` that all
scenes have; then the rotation matrix and the longest path.
"""

from thirdbody.kernels.columns import body, body_extra, sphere
from thirdbody.kernels.columns.table import Table

table = Table("scratch", "a chunk of bodies")

table.skip(body.WIDTH)
MID_SPIN, MID_SPIN3 = table.vector("mid_spin", 3, "rad/s", "angular velocity in the middle of the step", at=sphere.MID_SPIN)
END_VELOCITY, END_VELOCITY3 = table.vector("end_velocity", 3, "m/s", "predicted for its end", at=sphere.END_VELOCITY)
END_SPIN, END_SPIN3 = table.vector("end_spin", 3, "rad/s", "predicted for its end", at=sphere.END_SPIN)
ANGULAR_MOMENTUM, ANGULAR_MOMENTUM3 = table.vector(
    "angular_momentum", 3, "kg m2/s", "angular momentum, world axes", at=body.WIDTH + body_extra.ANGULAR_MOMENTUM
)
LONGEST_ARM = table.scalar("longest_arm", "m", "of the farthest sphere", at=body.WIDTH + body_extra.LONGEST_ARM)
INERTIA, INERTIA3 = table.vector("inertia", 3, "kg m2", "principal moments", at=body.WIDTH + body_extra.INERTIA)
table.skip(1)
MATRIX, MATRIX9 = table.vector("matrix", 9, "", "rotation matrix, body to world, row by row")
PATH = table.scalar("path", "m", "longest path of a point in the step")
WIDTH = table.width
