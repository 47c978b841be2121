"""Settings of the implicit integrator: one row."""

from thirdbody.kernels.columns.table import Table

table = Table("V", "the run")

TOLERANCE = table.scalar("tolerance", "", "error of a step over the radius of the largest contact")
LONGEST = table.scalar("longest", "m", "longest drag of a step")
SHORTEST = table.scalar("shortest", "s", "length of the shortest step that is tried")
INERTIAL = table.scalar("inertial", "", "1: bodies keep their momentum; 0: every step begins at rest")
EXPECTED_OVERLAP = table.scalar("expected_overlap", "m", "overlap to expect")
GROWTH = table.scalar("growth", "", "largest ratio of a step to the last one")
RADII = table.scalar("radii", "", "longest drag of a step over the radius of the largest contact")
WORK = table.scalar("work", "", "error of a step in the friction work, in parts of the energies in play")
WIDTH = table.width
