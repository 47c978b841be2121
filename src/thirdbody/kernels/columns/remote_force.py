"""Forces of contacts between two groups on their partners, in this step; zero for open contacts, and once they are added."""

from thirdbody.kernels.columns.table import Table

table = Table("F", "a contact between two groups of bodies")

FORCE, FORCE3 = table.vector("force", 3, "N", "force on the partner's body")
FRICTION_WORK = table.scalar("friction_work", "J", "the partner's part of the friction work")
TORQUE, TORQUE3 = table.vector("torque", 3, "N m", "torque on the partner's body")
SLIP = table.scalar("slip", "m", "the partner's part of the slip")
WIDTH_WITHOUT_NORMAL_LOSS = table.width
NORMAL_LOSS = table.scalar("normal_loss", "J", "the partner's part of what a normal law dissipates, as for bodies")
WIDTH = table.skip(3)
