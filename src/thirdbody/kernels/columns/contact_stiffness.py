"""Stiffness and damping of a contact, for the bound of the time step."""

from thirdbody.kernels.columns.table import Table

table = Table("stiffnesses", "a contact")

NORMAL, NORMAL3 = table.vector("normal", 3, "", "unit normal from partner to owner")
table.skip(1)
STIFFNESS, STIFFNESS3 = table.vector("stiffness", 3, "N/m, N m", "k_n - k_t, k_t, k_r")
COUNT = table.scalar("count", "", "how often it counts in the bound: 2 if the partner moves, too, else 1")
TWIST = table.scalar("twist", "N m", "k_w, rotation about the normal; replaces the count", at=COUNT)
DAMPING, DAMPING3 = table.vector("damping", 3, "N s/m, N m s", "the same of the dashpots")
PATCH = table.scalar("patch", "", "the patch that it presses; -1: none")
TWIST_DAMPING = table.scalar("twist_damping", "N m s", "k_w of the dashpots; replaces the patch", at=PATCH)
WIDTH = table.width
