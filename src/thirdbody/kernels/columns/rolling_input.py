"""Fields of a tile after the history of `law_input`: relative rotation; that about the normal only for twisting laws."""

from thirdbody.kernels.columns.table import Table

table = Table("I, behind the history", "a tile of contacts")

ROTATION_X = table.scalar("rotation_x", "rad", "relative rotation of the step about the first axis of the frame")
ROTATION_Y = table.scalar("rotation_y", "rad", "about the second one")
RATE_X = table.scalar("rate_x", "rad/s", "relative angular velocity at the end of the step, about the first axis")
RATE_Y = table.scalar("rate_y", "rad/s", "about the second one")
TRAVEL_X = table.scalar("travel_x", "m", "travel of the contact area over the surfaces in the step, along the first axis")
TRAVEL_Y = table.scalar("travel_y", "m", "along the second one")
INVERSE_DT = table.scalar("inverse_dt", "1/s", "one over the length of the step, for tangents; 0 where nothing moves in time")
MOVED = table.scalar("moved", "m", "overlap gained in the step, for laws whose force jumps at touch; else not set")
TWIST = table.scalar("twist", "rad", "relative rotation of the step about the normal")
TWIST_RATE = table.scalar("twist_rate", "rad/s", "relative angular velocity about the normal at the end of the step")
WIDTH = table.width
