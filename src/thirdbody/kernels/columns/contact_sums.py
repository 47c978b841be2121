"""Sums over the contacts of a group: one row for contacts with plates, one for those between spheres."""

from thirdbody.kernels.columns.table import Table

table = Table("sums", "the contacts of a group, with plates or between spheres")

FRICTION_WORK = table.scalar("friction_work", "J", "dissipated by friction in the step")
DAMPING_WORK = table.scalar("damping_work", "J", "dissipated by dashpots in the step")
MAX_OVERLAP = table.scalar("max_overlap", "", "largest overlap over the smaller radius")
SLOT = table.scalar("slot", "", "its contact")
BAD_SLOT = table.scalar("bad_slot", "", "the last contact whose force is not finite, plus 1; 0: none")
STORED_NORMAL = table.scalar("stored_normal", "J", "energy of the normal springs")
STORED_TANGENTIAL = table.scalar("stored_tangential", "J", "energy of the tangential and rolling springs")
table.skip(1)
UPPER_FORCE, UPPER_FORCE3 = table.vector("upper_force", 3, "N", "force of the upper plate")
table.skip(1)
LOWER_FORCE, LOWER_FORCE3 = table.vector("lower_force", 3, "N", "force of the lower plate")
WIDTH = table.skip(1)
