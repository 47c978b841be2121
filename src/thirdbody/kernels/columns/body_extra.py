"""Bodies: quantities that a single-sphere body needs in few steps only; without effects and normal losses one cache line."""

from thirdbody.kernels.columns.table import Table

table = Table("E", "a body")

ANGULAR_MOMENTUM, ANGULAR_MOMENTUM3 = table.vector(
    "angular_momentum", 3, "kg m2/s", "world axes: as the velocity, but of a single sphere where output needs it"
)
LONGEST_ARM = table.scalar("longest_arm", "m", "distance of the farthest centre of a sphere from the centre of mass")
INERTIA, INERTIA3 = table.vector("inertia", 3, "kg m2", "principal moments of inertia")
UPPER_PUSH = table.scalar("upper_push", "N", "force of the upper plate on the body, upwards; a patch feels it")
WIDTH_WITHOUT_EFFECTS = table.width
EFFECT_FORCE, EFFECT_FORCE3 = table.vector("effect_force", 3, "N", "force of body effects; only in scenes that have some")
NORMAL_LOSS = table.scalar("normal_loss", "J", "dissipated by a normal law: flow, necks; only in scenes with one that does")
EFFECT_TORQUE, EFFECT_TORQUE3 = table.vector("effect_torque", 3, "N m", "torque of body effects; only in scenes that have some")
WIDTH = table.skip(1)
