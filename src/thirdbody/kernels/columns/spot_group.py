"""Two or three spots of a body on one plate, in the scratch of `spot_loads`: a lane of LANES, structure of arrays."""

from thirdbody.kernels.columns.table import Table

table = Table("L", "a group of two or three spots")

ROW = table.scalar("row", "", "where its rows of W begin")
COUNT = table.scalar("count", "", "number of its spots")
COMPLIANCE = table.scalar("compliance", "m2/N", "displacement of the plate times distance over force")
X, X3 = table.vector("x", 3, "m", "centres of the spheres from that of the body, along x")
Y, Y3 = table.vector("y", 3, "m", "the same along y")
RADIUS, RADIUS3 = table.vector("radius", 3, "m", "effective radii")
SPHERE_RADIUS, SPHERE_RADIUS3 = table.vector("sphere_radius", 3, "m", "radii of the spheres")
FACTOR, FACTOR3 = table.vector("factor", 3, "N/m3", "forces over the cubes of the contact radii")
SQUARE, SQUARE3 = table.vector("square", 3, "m2", "squares of the contact radii that they would have alone")
CONVERGED = table.scalar("converged", "", "1: Newton's method converged")
FORCE, FORCE3 = table.vector("force", 3, "N", "normal forces")
RELIEF, RELIEF3 = table.vector("relief", 3, "m", "what the others lower the plate")
PULL_X, PULL_X3 = table.vector("pull_x", 3, "N", "forces along the plate, along x")
PULL_Y, PULL_Y3 = table.vector("pull_y", 3, "N", "the same along y")
WIDTH = table.width
