"""Fields of a tile after the history of `law_output`: moments, and forces of the dashpots."""

from thirdbody.kernels.columns.table import Table

table = Table("O, behind the history", "a tile of contacts")

MOMENT_X = table.scalar("moment_x", "N m", "moment on the owner about the first axis of the frame")
MOMENT_Y = table.scalar("moment_y", "N m", "about the second one")
MOMENT_LIMIT = table.scalar("moment_limit", "N m", "largest moment")
VISCOUS_NORMAL = table.scalar("viscous_normal", "N", "normal force of the dashpot")
VISCOUS_X = table.scalar("viscous_x", "N", "tangential force of the dashpot along the first axis")
VISCOUS_Y = table.scalar("viscous_y", "N", "along the second one")
VISCOUS_MOMENT_X = table.scalar("viscous_moment_x", "N m", "moment of the dashpot about the first axis")
VISCOUS_MOMENT_Y = table.scalar("viscous_moment_y", "N m", "about the second one")
TWIST_MOMENT = table.scalar("twist_moment", "N m", "moment on the owner about the normal; only with a twisting law")
TWIST_LIMIT = table.scalar("twist_limit", "N m", "largest moment about the normal")
VISCOUS_TWIST = table.scalar("viscous_twist", "N m", "moment of the dashpot about the normal")
WIDTH = table.width
