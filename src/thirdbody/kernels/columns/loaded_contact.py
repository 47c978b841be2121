"""A loaded contact of a body, as a labeller sees it; the labeller's memory of it begins at MEMORY."""

from thirdbody.kernels.columns.table import Table

table = Table("C", "a loaded contact of a body")

PARTNER = table.scalar("partner", "", "what it is with: LOWER, UPPER, DEBRIS")
POINT, POINT3 = table.vector("point", 3, "m", "contact point from the centre of mass")
NORMAL, NORMAL3 = table.vector("normal", 3, "", "unit normal from the partner to the body")
SPHERE_RADIUS = table.scalar("sphere_radius", "m", "radius of the body's sphere")
CONTACT_RADIUS = table.scalar("contact_radius", "m", "radius of the contact area")
OVERLAP = table.scalar("overlap", "m", "overlap")
NORMAL_FORCE = table.scalar("normal_force", "N", "total normal force")
LOAD = table.scalar("load", "N", "load that friction feels")
TANGENTIAL_FORCE, TANGENTIAL_FORCE3 = table.vector("tangential_force", 3, "N", "tangential force on the body")
FRICTION_LIMIT = table.scalar("friction_limit", "N", "largest tangential force")
CRITICAL_SLIP = table.scalar("critical_slip", "m", "displacement at which a virgin contact under this load slips throughout")
SLIP = table.scalar("slip", "m", "slip since it closed")
PARTNER_VELOCITY, PARTNER_VELOCITY3 = table.vector("partner_velocity", 3, "m/s", "velocity of the partner's surface there")
IDENTITY = table.scalar("identity", "", "number of the pair of surfaces, unique within the body")
MEMORY = table.width
