"""Memory of the labeller for a body: one row."""

from thirdbody.plugin import Table

from .support_geometry import is_plain

table = Table("m", "a body")

REFERENCE = is_plain(table.scalar("reference_w", "", "orientation at the reference, w"))
table.scalar("reference_x", "", "x")
table.scalar("reference_y", "", "y")
table.scalar("reference_z", "", "z")
CHANGE = is_plain(table.scalar("change_w", "", "orientation where the rule for free bodies began, w"))
table.scalar("change_x", "", "x")
table.scalar("change_y", "", "y")
table.scalar("change_z", "", "z")
TRAVEL = table.scalar("travel", "m", "path of the drag since the reference")
CHANGE_X = table.scalar("change_drag_x", "m", "drag since the rule for free bodies began, x")
CHANGE_Y = table.scalar("change_drag_y", "m", "y")
# from WINDOWS up to ROLLED: cleared by a stop or a reversal
WINDOWS = table.scalar("windows", "", "number of closed windows")
ROLL_RATIO = table.scalar("roll_ratio", "", "roll ratio of the last closed window")
PIVOTED = table.scalar("pivoted", "", "1: that window turned more about the normal than in plane")
SLIP_RATIO = table.scalar("slip_over_travel", "", "largest slip over the path in that window")
HEADING_X = table.scalar("heading_x", "m", "heading of a one-sided body, x")
HEADING_Y = table.scalar("heading_y", "m", "y")
REVERSED_PATH = table.scalar("reversed_path", "m", "path against its heading")
REST_TIME = table.scalar("rest_time", "s", "time since the last test for rest")
REST_PATH = table.scalar("rest_path", "m", "path since then")
ROLLED = table.scalar("rolled_distance", "m", "length rolled")
LIFTED = table.scalar("lifted", "", "1: a spot lifted off since the reference")
COUNT = table.scalar("loaded_count", "", "number of loaded spots")
SERIAL = table.scalar("serial", "", "number of the last observation with contacts")
PLATE_X = table.scalar("plate_direction_x", "", "direction of the drag at the last observation, x")
PLATE_Y = table.scalar("plate_direction_y", "", "y")
MOVING = table.scalar("plates_moving", "", "1: the plates moved then")
FREE_ROTATION = table.scalar("free_rotation", "rad", "rotation while the body was free")
NAMES = table.names()
