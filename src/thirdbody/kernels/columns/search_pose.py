"""Pose of a body at the last neighbour search."""

from thirdbody.kernels.columns.table import Table

table = Table("X0", "a body")

POSITION, POSITION3 = table.vector("position", 3, "m", "centre of mass")
QUATERNION, QUATERNION4 = table.vector("quaternion", 4, "", "orientation w, x, y, z; body to world")
WIDTH = table.width
