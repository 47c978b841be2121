"""What the labeller writes for a body: one row; margins and extras in the order of the contract of labellers."""

from thirdbody.plugin import Table

from .support_geometry import is_plain

table = Table("out", "a body")

STATE = table.scalar("state", "", "code of the state")
REASON = table.scalar("reason", "", "code of the reason")
FRICTION = table.scalar("friction", "", "1 - largest utilisation of friction over all spots")
UPPER = table.scalar("friction_upper", "", "1 - smallest utilisation of the upper spots")
LOWER = table.scalar("friction_lower", "", "1 - smallest utilisation of the lower spots")
FORCE = table.scalar("force_balance", "", "distance from static equilibrium of forces; negative: inertia carries the body")
MOMENT = table.scalar("moment_balance", "", "the same of moments about the centre of mass")
DETERMINACY = table.scalar("determinacy", "", "spread of a side's spots along the drag over the contact radius, minus 1")
ROTATION = table.scalar("rotation", "", "distance from rolling; negative or zero: it rolls")
SIDE = table.scalar("sliding_side", "", "side that slides: 0 none, 1 lower, 2 upper, 3 both")
ROLL = table.scalar("roll_ratio", "", "rotation times lever over the drag of a window; 1 rolls without slip")
SLIP = table.scalar("slip_over_travel", "", "largest slip of a spot over the drag of a window")
ROLLED = table.scalar("rolled_distance", "m", "length rolled since the start")
FORECAST = is_plain(table.scalar("forecast", "", "forecast, bits: 1 can stick, 2 can slide along the drag, 4 none"))
table.scalar("mu_required", "", "friction needed to stick")
table.scalar("t_min", "", "smallest friction at which it can slide")
table.scalar("t_max", "", "largest friction at which it can slide")

WIDTH = table.width
MARGINS = table.names()[FRICTION:SIDE]
EXTRAS = table.names()[SIDE:]
FORECASTS = table.names()[FORECAST:]
CODES = ("sliding_side", "forecast")
