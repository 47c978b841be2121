"""Periodic lengths, limits of the guards, and skin of the search: one row."""

from thirdbody.kernels.columns.table import Table

table = Table("D", "the run")

LENGTH_X = table.scalar("length_x", "m", "periodic length; 0: unbounded; negative: walls at that distance")
LENGTH_Y = table.scalar("length_y", "m", "the same along y")
OVERLAP_GUARD = table.scalar("overlap_guard", "", "largest overlap over the smaller radius")
TRAVEL_GUARD = table.scalar("travel_guard", "", "largest displacement in a step over the radius")
SKIN = table.scalar("skin", "m", "distance up to which candidates are listed")
FLOOR = table.scalar("floor", "m", "height below which no body may be; -inf without a lower plate")
WIDTH = table.width
