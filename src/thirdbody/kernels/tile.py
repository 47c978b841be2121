"""Tables of a tile, the block of contacts on which laws work: structure of arrays, TILE numbers per field."""

from thirdbody.kernels.table import Table, mark, number, vector

TILE = 64  # contacts per tile

# Inputs of the laws (stride TILE); `rolling_input` follows the history, only if a law requests it.
law_input = Table(
    "I",
    "a tile of contacts",
    overlap=number("m", "overlap"),
    radius=number("m", "effective radius"),
    mass=number("kg", "effective mass"),
    normal_velocity=number("m/s", "normal relative velocity at the end of the step; positive: separating"),
    slip_x=number("m", "slip of the step along the first axis of the frame"),
    slip_y=number("m", "along the second one"),
    velocity_x=number("m/s", "tangential relative velocity at the end of the step, along the first axis"),
    velocity_y=number("m/s", "along the second one"),
    pair_type=number("", "row of the table of parameters"),
    history=number("", "history of the laws, from here on; fields: `kernels.memory`"),
)

# Fields of a tile after the history of `law_input`: relative rotation; that about the normal only for twisting laws.
rolling_input = Table(
    "I, behind the history",
    "a tile of contacts",
    rotation_x=number("rad", "relative rotation of the step about the first axis of the frame"),
    rotation_y=number("rad", "about the second one"),
    rate_x=number("rad/s", "relative angular velocity at the end of the step, about the first axis"),
    rate_y=number("rad/s", "about the second one"),
    travel_x=number("m", "travel of the contact area over the surfaces in the step, along the first axis"),
    travel_y=number("m", "along the second one"),
    inverse_dt=number("1/s", "one over the length of the step, for tangents; 0 where nothing moves in time"),
    moved=number("m", "overlap gained in the step, for laws whose force jumps at touch; else not set"),
    twist=number("rad", "relative rotation of the step about the normal"),
    twist_rate=number("rad/s", "relative angular velocity about the normal at the end of the step"),
)

# Outputs of the laws (stride TILE); `rolling_output` follows the history, only if a law requests it.
law_output = Table(
    "O",
    "a tile of contacts",
    normal_force=number("N", "total normal force on the owner, along the normal"),
    tangential_x=number("N", "tangential force on the owner along the first axis of the frame"),
    tangential_y=number("N", "along the second one"),
    load=number("N", "load that friction feels"),
    friction_limit=number("N", "largest tangential force"),
    critical_slip=number("m", "displacement at which a virgin contact under this load slips throughout"),
    slip=number("m", "slip of the step"),
    contact_radius=number("m", "radius of the contact area"),
    peak_pressure=number("Pa", "largest pressure in the contact area"),
    stored_normal=number("J", "energy of the normal springs"),
    stored_tangential=number("J", "energy of the tangential and rolling springs"),
    dissipated=number("J", "all that the laws dissipate in the step"),
    friction_loss=number("J", "the part of it that tangential and rolling laws dissipate"),
    dashpot_power=number("W", "power of the dashpots at the end of the step; after `books` their work in it, J"),
    history=number("", "history of the laws, from here on; fields: `kernels.memory`"),
)

# Fields of a tile after the history of `law_output`: moments, and forces of the dashpots.
rolling_output = Table(
    "O, behind the history",
    "a tile of contacts",
    moment_x=number("N m", "moment on the owner about the first axis of the frame"),
    moment_y=number("N m", "about the second one"),
    moment_limit=number("N m", "largest moment"),
    viscous_normal=number("N", "normal force of the dashpot"),
    viscous_x=number("N", "tangential force of the dashpot along the first axis"),
    viscous_y=number("N", "along the second one"),
    viscous_moment_x=number("N m", "moment of the dashpot about the first axis"),
    viscous_moment_y=number("N m", "about the second one"),
    twist_moment=number("N m", "moment on the owner about the normal; only with a twisting law"),
    twist_limit=number("N m", "largest moment about the normal"),
    viscous_twist=number("N m", "moment of the dashpot about the normal"),
)

contact_tangent = Table(
    "K",
    "a tile of contacts; those of moments only with a law of the rolling or twisting stage",
    normal=number("N/m", "change of the normal force with the overlap"),
    xx=number("N/m", "change of the tangential force x with the slip x"),
    xy=number("N/m", "of x with slip y"),
    yx=number("N/m", "of y with slip x"),
    yy=number("N/m", "of y with slip y"),
    xd=number("N/m", "of x with the overlap"),
    yd=number("N/m", "of y with the overlap"),
    width=mark(),
    rolling=vector(6, "N m/rad, N", "the same six of the moment: xx, xy, yx, yy with rotations, xd, yd"),
    twist=number("N m/rad", "change of the moment about the normal with the rotation about it"),
    twist_overlap=number("N", "of the moment about the normal with the overlap"),
    rolling_width=mark(),
    spring_x=number("N", "force of the spring x, from what the law has answered; read by laws with a field only"),
    spring_y=number("N", "the same y"),
    spring_limit=number("N", "its friction limit"),
    relieved=vector(7, "", "scratch of interacting spots: relieved overlap by the coordinates"),
    spots_width=mark(),
)

geometry = Table(
    "G",
    "a tile of contacts, and forces on their bodies",
    normal=vector(3, "", "unit normal from partner to owner"),
    mid_normal=vector(3, "", "unit normal in the middle of the step"),
    axis=vector(3, "", "first axis of the contact's frame, carried along"),
    cross_axis=vector(3, "", "second axis: normal times the first one"),
    arm=number("m", "from the centre of the owner's sphere to the contact point"),
    partner_arm=number("m", "the same of the partner"),
    mid_velocity=vector(3, "m/s", "relative velocity of the centres, of the step"),
    mid_spin=vector(3, "rad/s", "sum of the spins, of the step"),
    mid_rim=vector(3, "m/s", "sum of the spins, each times its radius, of the step"),
    end_velocity=vector(3, "m/s", "relative velocity of the centres, at its end"),
    end_spin=vector(3, "rad/s", "sum of the spins, at its end"),
    end_rim=vector(3, "m/s", "sum of the spins, each times its radius, at its end"),
    previous_slip=number("m", "`contact_state.SLIP` of the last step: 0 where it was open"),
    radius=number("m", "radius of the owner's sphere"),
    partner_radius=number("m", "radius of the partner's sphere"),
    partner_mass=number("kg", "mass of the partner's body"),
    relief=number("m", "what the other spots of the body lower the plate; only with an interaction of spots"),
    spot_force=number("N", "elastic normal force of the spot; likewise"),
    pull=vector(2, "N", "force along the plate towards the other spots; likewise"),
    width=mark(),
    force=vector(3, "N", "force on the owner", at="mid_velocity"),
    torque=vector(3, "N m", "torque about the centre of the owner's sphere", at="mid_spin"),
    partner_torque=vector(3, "N m", "torque about that of the partner's", at="mid_rim"),
)
