"""Orientations of bodies: no force on a single sphere depends on its own."""

from thirdbody.kernels.columns.table import Table

table = Table("orientations", "a body")

QUATERNION, QUATERNION4 = table.vector("quaternion", 4, "", "orientation w, x, y, z; body to world")
WIDTH = table.width
