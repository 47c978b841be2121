"""Spots of a body on the plates, in the scratch of `spot_loads`."""

from thirdbody.kernels.columns.table import Table

table = Table("W", "a spot")

NUMBER = table.scalar("number", "", "its contact, in the list of the group")
X = table.scalar("x", "m", "centre of its sphere from that of its body, along x")
Y = table.scalar("y", "m", "the same along y")
RADIUS = table.scalar("radius", "m", "effective radius")
OVERLAP = table.scalar("overlap", "m", "overlap with the undeformed plate")
SQUARE = table.scalar("square", "m2", "square of the contact radius that it would have alone")
FACTOR = table.scalar("factor", "N/m3", "force over the cube of the contact radius")
SPHERE_RADIUS = table.scalar("sphere_radius", "m", "radius of its sphere")
WIDTH = table.width
