"""Outputs of the laws (stride TILE); `rolling_output` follows the history, only if a law requests it."""

from thirdbody.kernels.columns.table import Table

table = Table("O", "a tile of contacts")

NORMAL_FORCE = table.scalar("normal_force", "N", "total normal force on the owner, along the normal")
TANGENTIAL_X = table.scalar("tangential_x", "N", "tangential force on the owner along the first axis of the frame")
TANGENTIAL_Y = table.scalar("tangential_y", "N", "along the second one")
LOAD = table.scalar("load", "N", "load that friction feels")
FRICTION_LIMIT = table.scalar("friction_limit", "N", "largest tangential force")
CRITICAL_SLIP = table.scalar("critical_slip", "m", "displacement at which a virgin contact under this load slips throughout")
SLIP = table.scalar("slip", "m", "slip of the step")
CONTACT_RADIUS = table.scalar("contact_radius", "m", "radius of the contact area")
PEAK_PRESSURE = table.scalar("peak_pressure", "Pa", "largest pressure in the contact area")
STORED_NORMAL = table.scalar("stored_normal", "J", "energy of the normal springs")
STORED_TANGENTIAL = table.scalar("stored_tangential", "J", "energy of the tangential and rolling springs")
DISSIPATED = table.scalar("dissipated", "J", "all that the laws dissipate in the step")
FRICTION_LOSS = table.scalar("friction_loss", "J", "the part of it that tangential and rolling laws dissipate")
DASHPOT_POWER = table.scalar(
    "dashpot_power", "W", "power of the dashpots at the end of the step; after `explicit.contact_dissipation` their work in it, J"
)
HISTORY = table.scalar("history", "", "history of the laws, from here on; fields: `kernels.contact_fields`")
