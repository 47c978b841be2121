"""The full record of a contact, written in observed steps; no rows where records are not needed."""

from thirdbody.kernels.columns.table import Table

table = Table("R", "a candidate contact")

POINT, POINT3 = table.vector("point", 3, "m", "contact point from the centre of mass of the owner's body")
PARTNER_POINT, PARTNER_POINT3 = table.vector("partner_point", 3, "m", "the same from that of the partner's body")
NORMAL, NORMAL3 = table.vector("normal", 3, "", "unit normal from partner to owner")
SPHERE_RADIUS = table.scalar("sphere_radius", "m", "radius of the owner's sphere")
PARTNER_RADIUS = table.scalar("partner_radius", "m", "radius of the partner's sphere; 0 for a plate")
CONTACT_RADIUS = table.scalar("contact_radius", "m", "radius of the contact area")
OVERLAP = table.scalar("overlap", "m", "overlap")
NORMAL_FORCE = table.scalar("normal_force", "N", "total normal force")
LOAD = table.scalar("load", "N", "load that friction feels")
TANGENTIAL_FORCE, TANGENTIAL_FORCE3 = table.vector("tangential_force", 3, "N", "tangential force on the owner")
FRICTION_LIMIT = table.scalar("friction_limit", "N", "largest tangential force")
CRITICAL_SLIP = table.scalar("critical_slip", "m", "displacement at which a virgin contact under this load slips throughout")
SURFACE_VELOCITY, SURFACE_VELOCITY3 = table.vector("surface_velocity", 3, "m/s", "velocity of the owner's surface at the contact")
PARTNER_VELOCITY, PARTNER_VELOCITY3 = table.vector("partner_velocity", 3, "m/s", "velocity of the partner's surface there")
STORED_NORMAL = table.scalar("stored_normal", "J", "energy of the normal springs")
STORED_TANGENTIAL = table.scalar("stored_tangential", "J", "energy of the tangential and rolling springs")
EFFECTIVE_RADIUS = table.scalar("effective_radius", "m", "effective radius of curvature")
PEAK_PRESSURE = table.scalar("peak_pressure", "Pa", "largest pressure in the contact area")
WIDTH = table.width
MOMENT, MOMENT3 = table.vector("moment", 3, "N m", "moment on the owner; only in scenes with a rolling law")
MOMENT_LIMIT = table.scalar("moment_limit", "N m", "largest moment; only in scenes with a rolling law")
ROLLING_WIDTH = table.width
TWIST_MOMENT = table.scalar("twist_moment", "N m", "moment on the owner about the normal; only in scenes with a twisting law")
TWIST_LIMIT = table.scalar("twist_limit", "N m", "largest moment about the normal; only in scenes with a twisting law")
TWIST_WIDTH = table.width
