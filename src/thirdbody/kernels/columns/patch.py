"""Patches of the upper plate: one per body, or one for a rigid plate; on a foundation the last row is the common plate."""

from thirdbody.kernels.columns.table import Table

table = Table("P", "a patch")

HEIGHT = table.scalar("height", "m", "height of its surface")
VELOCITY = table.scalar("velocity", "m/s", "velocity, upwards")
MASS = table.scalar("mass", "kg", "mass")
DAMPING = table.scalar("damping", "N s/m", "coefficient of its dashpot")
LOAD = table.scalar("load", "N", "load of now, downwards")
FORCE = table.scalar("force", "N", "force of debris and springs, upwards")
FREE = table.scalar("free", "", "1: it moves under its load; 0: its motion is prescribed")
SEARCH_HEIGHT = table.scalar("search_height", "m", "height at the last search for neighbours")
SPRING = table.scalar("spring", "N/m", "stiffness of its spring to the common plate")
NOMINAL_LOAD = table.scalar("nominal_load", "N", "load of which a schedule of loads gives the factor")
DISPLACEMENT, DISPLACEMENT2 = table.vector("displacement", 2, "m", "displacement along x and y since the start")
DIRECT_PREFACTOR = table.scalar("direct_prefactor", "N", "force of direct contact of the plates at zero gap; 0: none")
DIRECT_LENGTH = table.scalar("direct_length", "m", "change of the gap that divides that force by e")
DIRECT_FRICTION = table.scalar("direct_friction", "", "friction coefficient of direct contact")
WIDTH = table.width
