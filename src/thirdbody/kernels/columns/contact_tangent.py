"""Tangents of contacts (stride TILE); those of moments only with a law of the rolling or of the twisting stage."""

from thirdbody.kernels.columns.table import Table

table = Table("K", "a tile of contacts")

NORMAL = table.scalar("normal", "N/m", "change of the normal force with the overlap")
XX = table.scalar("xx", "N/m", "change of the tangential force x with the slip x")
XY = table.scalar("xy", "N/m", "of x with slip y")
YX = table.scalar("yx", "N/m", "of y with slip x")
YY = table.scalar("yy", "N/m", "of y with slip y")
XD = table.scalar("xd", "N/m", "of x with the overlap")
YD = table.scalar("yd", "N/m", "of y with the overlap")
WIDTH = table.width
ROLLING, ROLLING6 = table.vector("rolling", 6, "N m/rad, N", "the same six of the moment: xx, xy, yx, yy with rotations, xd, yd")
TWIST = table.scalar("twist", "N m/rad", "change of the moment about the normal with the rotation about it")
TWIST_OVERLAP = table.scalar("twist_overlap", "N", "of the moment about the normal with the overlap")
ROLLING_WIDTH = table.width
SPRING_X = table.scalar("spring_x", "N", "force of the spring x, from what the law has answered; read by laws with a field only")
SPRING_Y = table.scalar("spring_y", "N", "the same y")
SPRING_LIMIT = table.scalar("spring_limit", "N", "its friction limit")
RELIEVED, RELIEVED7 = table.vector("relieved", 7, "", "scratch of interacting spots: relieved overlap by the coordinates")
SPOTS_WIDTH = table.width
