"""Bodies, columns in groups of four: 160 bytes, all that a single-sphere body needs in a step.

Where bodies and spheres are one table, force and torque are in the columns of the velocities predicted for the end of the step:
the contacts need these, and from then on the next step needs what the contacts have summed (`body_force`).
"""

from thirdbody.kernels.columns import sphere
from thirdbody.kernels.columns.table import Table

table = Table("B", "a body")

POSITION, POSITION3 = table.vector("position", 3, "m", "centre of mass", at=sphere.POSITION)
VELOCITY, VELOCITY3 = table.vector(
    "velocity", 3, "m/s", "velocity: of now when synchronised, of mid-step inside a step", at=sphere.MID_VELOCITY
)
MASS = table.scalar("mass", "kg", "mass", at=sphere.MASS)
SPIN, SPIN3 = table.vector(
    "spin", 3, "rad/s", "angular velocity: of a single sphere as the velocity, else where output needs it", at=sphere.MID_SPIN
)
SPHERE_INERTIA = table.scalar("sphere_inertia", "kg m2", "moment of inertia of a single-sphere body; 0: not one")
FORCE, FORCE3 = table.vector("force", 3, "N", "total force at the end of the last step", at=sphere.END_VELOCITY)
FRICTION_WORK = table.scalar("friction_work", "J", "friction work since the start; behind the force, to be summed with it")
TORQUE, TORQUE3 = table.vector("torque", 3, "N m", "total torque at the end of the last step", at=sphere.END_SPIN)
SLIP_DISTANCE = table.scalar("slip_distance", "m", "slip of all its contacts since the start; behind the torque")
WIDTH = table.width
