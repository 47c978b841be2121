"""Periodic lengths, limits of the guards, skin of the search and reach of the laws: one row."""

from thirdbody.kernels.columns.table import Table

table = Table("D", "the run")

LENGTH_X = table.scalar("length_x", "m", "periodic length; 0: unbounded; negative: walls at that distance")
LENGTH_Y = table.scalar("length_y", "m", "the same along y")
OVERLAP_GUARD = table.scalar("overlap_guard", "", "largest overlap over the smaller radius")
TRAVEL_GUARD = table.scalar("travel_guard", "", "largest displacement in a step over the radius")
SKIN = table.scalar("skin", "m", "distance beyond the reach up to which candidates are listed")
REACH = table.scalar("reach", "m", "distance from touch at which bodies begin to act on each other")
FLOOR = table.scalar("floor", "m", "height below which no body may be; -inf without a lower plate")
CURVED, CURVED2 = table.vector("curved", 2, "", "of the lower and the upper plate: 1: curvature enters the effective radius")
WIDTH = table.width
