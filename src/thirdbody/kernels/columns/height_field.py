"""Head of a height field (`kernels.height_field`); its coefficients and its pyramid of heights follow in the same row."""

from thirdbody.kernels.columns.table import Table

table = Table("field", "a surface; one row")

LENGTH_X = table.scalar("length_x", "m", "period along x")
LENGTH_Y = table.scalar("length_y", "m", "period along y")
COUNT_X = table.scalar("count_x", "", "number of cells along x")
COUNT_Y = table.scalar("count_y", "", "number of cells along y")
RATE_X = table.scalar("rate_x", "1/m", "cells per length along x")
RATE_Y = table.scalar("rate_y", "1/m", "cells per length along y")
MAX_HEIGHT = table.scalar("max_height", "m", "no point is higher")
MIN_HEIGHT = table.scalar("min_height", "m", "no point is lower")
MAX_SLOPE = table.scalar("max_slope", "", "no slope is steeper")
MAX_CURVATURE = table.scalar("max_curvature", "1/m", "the second derivatives of the height, as a matrix, have no larger norm")
LEVELS = table.scalar("levels", "", "levels of the pyramid; the last one is a single block")
OFFSET, OFFSETS = table.vector("offset", 24, "", "where in the row each level of the pyramid begins, from level 1 on")
WIDTH = table.width
