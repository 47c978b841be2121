"""Diagnostics of the contacts of a body that the residual of an implicit step returns: one row."""

from thirdbody.kernels.columns.table import Table

table = Table("diagnostics", "a body")

NORMAL_FORCE = table.scalar("normal_force", "N", "sum of the sizes of the normal forces")
MAX_OVERLAP = table.scalar("max_overlap", "m", "largest overlap")
MAX_RADIUS = table.scalar("max_radius", "m", "largest radius of a contact area")
MAX_RATIO = table.scalar("max_ratio", "", "largest overlap over the radius of its sphere")
SLOT = table.scalar("slot", "", "its contact")
WIDTH = table.width
