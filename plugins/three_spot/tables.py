"""Tables of the labeller: what it writes for a body, and its memory of a body and of a loaded contact."""

from thirdbody.plugin import Table, loaded_contact, number, skip

from .support_geometry import is_plain

# one row; margins and extras in the order of the contract of labellers
label_output = Table(
    "out",
    "a body",
    state=number("", "code of the state"),
    reason=number("", "code of the reason"),
    friction=number("", "1 - largest utilisation of friction over all spots"),
    friction_upper=number("", "1 - smallest utilisation of the upper spots"),
    friction_lower=number("", "1 - smallest utilisation of the lower spots"),
    force_balance=number("", "distance from static equilibrium of forces; negative: inertia carries the body"),
    moment_balance=number("", "the same of moments about the centre of mass"),
    determinacy=number("", "spread of a side's spots along the drag over the contact radius, minus 1"),
    rotation=number("", "distance from rolling; negative or zero: it rolls"),
    sliding_side=number("", "side that slides: 0 none, 1 lower, 2 upper, 3 both"),
    roll_ratio=number("", "rotation times lever over the drag of a window; 1 rolls without slip"),
    slip_over_travel=number("", "largest slip of a spot over the drag of a window"),
    rolled_distance=number("m", "length rolled since the start"),
    forecast=number("", "forecast, bits: 1 can stick, 2 can slide along the drag, 4 none"),
    mu_required=number("", "friction needed to stick"),
    t_min=number("", "smallest friction at which it can slide"),
    t_max=number("", "largest friction at which it can slide"),
)
label_output.FORECAST = is_plain(label_output.FORECAST)
MARGINS = label_output.names()[label_output.FRICTION : label_output.SLIDING_SIDE]
EXTRAS = label_output.names()[label_output.SLIDING_SIDE :]
FORECASTS = label_output.names()[label_output.FORECAST :]
CODES = ("sliding_side", "forecast")

body_memory = Table(
    "m",
    "a body",
    reference_w=number("", "orientation at the reference, w"),
    reference_x=number("", "x"),
    reference_y=number("", "y"),
    reference_z=number("", "z"),
    change_w=number("", "orientation where the rule for free bodies began, w"),
    change_x=number("", "x"),
    change_y=number("", "y"),
    change_z=number("", "z"),
    travel=number("m", "path of the drag since the reference"),
    change_drag_x=number("m", "drag since the rule for free bodies began, x"),
    change_drag_y=number("m", "y"),
    windows=number("", "number of closed windows"),
    roll_ratio=number("", "roll ratio of the last closed window"),
    pivoted=number("", "1: that window turned more about the normal than in plane"),
    slip_over_travel=number("", "largest slip over the path in that window"),
    heading_x=number("m", "heading of a one-sided body, x"),
    heading_y=number("m", "y"),
    reversed_path=number("m", "path against its heading"),
    rest_time=number("s", "time since the last test for rest"),
    rest_path=number("m", "path since then"),
    rolled_distance=number("m", "length rolled"),
    lifted=number("", "1: a spot lifted off since the reference"),
    loaded_count=number("", "number of loaded spots"),
    serial=number("", "number of the last observation with contacts"),
    plate_direction_x=number("", "direction of the drag at the last observation, x"),
    plate_direction_y=number("", "y"),
    plates_moving=number("", "1: the plates moved then"),
    free_rotation=number("rad", "rotation while the body was free"),
)
body_memory.REFERENCE, body_memory.CHANGE = is_plain(body_memory.REFERENCE_W), is_plain(body_memory.CHANGE_W)

# behind the columns of `loaded_contact`
contact_memory = Table(
    "C",
    "a loaded contact of a body",
    _=skip(loaded_contact.MEMORY),
    slip_at_reference=number("m", "slip at the reference"),
    slip_last_window=number("m", "slip in the last closed window"),
    stamp=number("", "number of the last observation in which it was loaded"),
)
