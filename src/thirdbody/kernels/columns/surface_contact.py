"""Where spheres are closest to rough plates, updated in every step. No rows where both plates are flat.

A sphere may have several contacts with a plate: one for each local minimum of the distance from its centre. Each keeps its row as
long as it exists; a sphere has `predicates.BASINS` rows per rough plate. The first of them also says which rows have a minimum.
"""

from thirdbody.kernels.columns.table import Table

table = Table("Q", "a candidate contact with a plate")

OFFSET, OFFSET2 = table.vector(
    "offset", 2, "m", "closest point of the surface, along x and y from below the centre of the sphere"
)
START, START2 = table.vector("start", 2, "m", "the same at the start of the last step")
START_DISTANCE = table.scalar(
    "start_distance", "m", "implicit: the distance at the start of the step, or a lower bound of one too far to touch"
)
DISTANCE = table.scalar("distance", "m", "from the surface to the centre of the sphere; without a minimum: none is shorter")
MINIMA = table.scalar("minima", "", "in the first row of a sphere: bits of the rows that have a minimum")
ENDED = table.scalar(
    "ended", "", "in the first row of a sphere: bits of rows whose minimum ended in the last update, then of the one before"
)
NORMAL, NORMAL3 = table.vector("normal", 3, "", "unit normal from the plate to the sphere, world axes")
RADIUS = table.scalar("radius", "m", "effective radius of curvature")
NORMAL_GRADIENT, NORMAL_GRADIENT6 = table.vector(
    "normal_gradient", 6, "1/m", "change of the normal with the place of the sphere, a symmetric tensor: xx, yy, zz, xy, xz, yz"
)
GRADIENT, GRADIENT3 = table.vector("gradient", 3, "1/m", "gradient of the logarithm of the effective radius, world axes")
GRADIENT_CHANGE, GRADIENT_CHANGE6 = table.vector(
    "gradient_change", 6, "1/m2", "implicit: its change with the place of the sphere, a symmetric tensor as above"
)
SEARCHED, SEARCHED3 = table.vector(
    "searched", 3, "m", "in the first row of a sphere: its centre at the last search for minima, in the coordinates of the plate"
)
NEARBY, NEARBY3 = table.vector("nearby", 3, "m", "scratch of the search: offset and distance of a minimum")
START_CENTRE, START_CENTRE3 = table.vector(
    "start_centre", 3, "m", "implicit, in the first row of a sphere: its centre at the start of the step, in the same coordinates"
)
WIDTH = table.width
