"""A body and its surroundings, as a labeller sees them: one row."""

from thirdbody.kernels.columns.table import Table

table = Table("observed", "a body")

MASS = table.scalar("mass", "kg", "mass")
POSITION, POSITION3 = table.vector("position", 3, "m", "centre of mass")
VELOCITY, VELOCITY3 = table.vector("velocity", 3, "m/s", "velocity")
QUATERNION, QUATERNION4 = table.vector("quaternion", 4, "", "orientation w, x, y, z; body to world")
SPIN, SPIN3 = table.vector("spin", 3, "rad/s", "angular velocity")
FORCE, FORCE3 = table.vector("force", 3, "N", "sum of contact forces, weight and other effects, without inertia")
TORQUE, TORQUE3 = table.vector("torque", 3, "N m", "sum of their moments about the centre of mass, without inertia")
EFFECT_FORCE, EFFECT_FORCE3 = table.vector("effect_force", 3, "N", "force of body effects")
EFFECT_TORQUE, EFFECT_TORQUE3 = table.vector("effect_torque", 3, "N m", "torque of body effects")
ELAPSED = table.scalar("elapsed", "s", "time since the last observation")
PLATE_SHIFT, PLATE_SHIFT2 = table.vector("plate_shift", 2, "m", "displacement of the upper plate since then")
DRAG, DRAG2 = table.vector("drag", 2, "", "unit vector of the drag of the upper plate")
PLATE_SPEED = table.scalar("plate_speed", "m/s", "speed of the upper plate")
WIDTH = table.width
