"""Motion of a chunk of bodies in a step: extrema, guards, power of effects."""

from thirdbody.kernels.columns.table import Table

table = Table("moves", "a chunk of bodies")

MAX_PATH = table.scalar("max_path", "m", "longest path of a point of a body in the step")
MAX_TRAVEL = table.scalar("max_travel", "", "largest path over the radius")
BODY = table.scalar("body", "", "its body")
BAD_BODY = table.scalar("bad_body", "", "the last body that is not finite, plus 1; 0: none")
LEFT_BODY = table.scalar("left_body", "", "the last body that left the domain, plus 1; 0: none")
EFFECT_POWER = table.scalar("effect_power", "W", "power of body effects")
WIDTH = table.width
