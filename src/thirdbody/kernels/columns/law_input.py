"""Inputs of the laws (stride TILE); `rolling_input` follows the history, only if a law requests it."""

from thirdbody.kernels.columns.table import Table

table = Table("I", "a tile of contacts")

OVERLAP = table.scalar("overlap", "m", "overlap")
RADIUS = table.scalar("radius", "m", "effective radius")
MASS = table.scalar("mass", "kg", "effective mass")
NORMAL_VELOCITY = table.scalar("normal_velocity", "m/s", "normal relative velocity at the end of the step; positive: separating")
SLIP_X = table.scalar("slip_x", "m", "slip of the step along the first axis of the frame")
SLIP_Y = table.scalar("slip_y", "m", "along the second one")
VELOCITY_X = table.scalar("velocity_x", "m/s", "tangential relative velocity at the end of the step, along the first axis")
VELOCITY_Y = table.scalar("velocity_y", "m/s", "along the second one")
PAIR_TYPE = table.scalar("pair_type", "", "row of the table of parameters")
HISTORY = table.scalar("history", "", "history of the laws, from here on; fields: `kernels.contact_fields`")
