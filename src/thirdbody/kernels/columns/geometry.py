"""Geometry of the contacts of a tile, and forces on their bodies (stride TILE, as in the laws' tables)."""

from thirdbody.kernels.columns.table import Table

table = Table("G", "a tile of contacts")

NORMAL, NORMAL3 = table.vector("normal", 3, "", "unit normal from partner to owner")
MID_NORMAL, MID_NORMAL3 = table.vector("mid_normal", 3, "", "unit normal in the middle of the step")
AXIS, AXIS3 = table.vector("axis", 3, "", "first axis of the contact's frame, carried along")
CROSS_AXIS, CROSS_AXIS3 = table.vector("cross_axis", 3, "", "second axis: normal times the first one")
ARM = table.scalar("arm", "m", "from the centre of the owner's sphere to the contact point")
PARTNER_ARM = table.scalar("partner_arm", "m", "the same of the partner")
MID_VELOCITY, MID_VELOCITY3 = table.vector("mid_velocity", 3, "m/s", "relative velocity of the centres, of the step")
MID_SPIN, MID_SPIN3 = table.vector("mid_spin", 3, "rad/s", "sum of the spins, of the step")
MID_RIM, MID_RIM3 = table.vector("mid_rim", 3, "m/s", "sum of the spins, each times its radius, of the step")
END_VELOCITY, END_VELOCITY3 = table.vector("end_velocity", 3, "m/s", "relative velocity of the centres, at its end")
END_SPIN, END_SPIN3 = table.vector("end_spin", 3, "rad/s", "sum of the spins, at its end")
END_RIM, END_RIM3 = table.vector("end_rim", 3, "m/s", "sum of the spins, each times its radius, at its end")
PREVIOUS_SLIP = table.scalar("previous_slip", "m", "`contact_state.SLIP` of the last step: 0 where it was open")
RADIUS = table.scalar("radius", "m", "radius of the owner's sphere")
PARTNER_RADIUS = table.scalar("partner_radius", "m", "radius of the partner's sphere")
PARTNER_MASS = table.scalar("partner_mass", "kg", "mass of the partner's body")
RELIEF = table.scalar("relief", "m", "what the other spots of the body lower the plate; only with an interaction of spots")
OVERLAP = table.scalar("overlap", "m", "overlap with the undeformed plate, while the laws see the relieved one; likewise")
SPOT_FORCE = table.scalar("spot_force", "N", "elastic normal force of the spot; likewise")
PULL, PULL2 = table.vector("pull", 2, "N", "force along the plate towards the other spots; likewise")
WIDTH = table.width

# results overwrite fields that are no longer needed
FORCE, FORCE3 = table.vector("force", 3, "N", "force on the owner", at=MID_VELOCITY)
TORQUE, TORQUE3 = table.vector("torque", 3, "N m", "torque about the centre of the owner's sphere", at=MID_SPIN)
PARTNER_TORQUE, PARTNER_TORQUE3 = table.vector("partner_torque", 3, "N m", "torque about that of the partner's", at=MID_RIM)
