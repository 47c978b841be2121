"""Forces on the bodies of a group in this step, while its contacts are summed: rows that the next groups use again."""

from thirdbody.kernels.columns.table import Table

table = Table("forces", "a body of a group")

FORCE, FORCE3 = table.vector("force", 3, "N", "force so far")
FRICTION_WORK = table.scalar("friction_work", "J", "friction work since the start")
TORQUE, TORQUE3 = table.vector("torque", 3, "N m", "torque so far")
SLIP_DISTANCE = table.scalar("slip_distance", "m", "slip since the start")
WIDTH = table.width
