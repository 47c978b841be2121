"""Solution of a body under a common plate, for a given rise of the plate."""

from thirdbody.kernels.columns.table import Table

table = Table("solutions", "a body")

SOLVED = table.scalar("solved", "", "1: its equilibrium was found")
PUSH = table.scalar("push", "N", "force on the plate, upwards")
SLOPE = table.scalar("slope", "N/m", "change of that force with the displacement of the plate, the body following")
ERROR = table.scalar("error", "", "error of the step over what is allowed")
ROTATION = table.scalar("rotation", "rad", "rotation in the step")
ITERATIONS = table.scalar("iterations", "", "iterations of Newton's method")
CROWDED = table.scalar("crowded", "", "1: it has more contacts than a tile holds")
LANDS = table.scalar("lands", "", "1: one of its contacts closed in the step")
IN_ISLAND = table.scalar("in_island", "", "1: it is solved together with the other bodies of its island")
WIDTH = table.width
