"""Spheres, columns in groups of four.

Mid-step velocities give the displacement of the step; those predicted for its end feed the dashpots. Quantities that bodies have,
too, are in the same columns (`body`): where every body is one sphere centred at its centre of mass, both are one table.
"""

from thirdbody.kernels.columns.table import Table

table = Table("S", "a sphere")

POSITION, POSITION3 = table.vector("position", 3, "m", "centre")
X, Y, Z = range(POSITION, POSITION + 3)
RADIUS = table.scalar("radius", "m", "radius")
MID_VELOCITY, MID_VELOCITY3 = table.vector("mid_velocity", 3, "m/s", "velocity of the centre in the middle of the step")
MASS = table.scalar("mass", "kg", "mass of its body")
MID_SPIN, MID_SPIN3 = table.vector("mid_spin", 3, "rad/s", "angular velocity in the middle of the step")
table.skip(1)
END_VELOCITY, END_VELOCITY3 = table.vector("end_velocity", 3, "m/s", "velocity of the centre predicted for the end of the step")
table.skip(1)
END_SPIN, END_SPIN3 = table.vector("end_spin", 3, "rad/s", "angular velocity predicted for the end of the step")
table.skip(1)
ARM, ARM3 = table.vector("arm", 3, "m", "centre from the centre of mass of its body, world axes; only in a table of its own")
WIDTH = table.skip(1)
