"""What a candidate contact remembers. Behind the history of the laws (four columns or more) stands the labeller's memory.

Most chains of laws remember four numbers: a row is a line of the cache.
"""

from thirdbody.kernels.columns.table import Table

table = Table("H", "a candidate contact")

AXIS, AXIS3 = table.vector("axis", 3, "", "first axis of its frame")
SLIP = table.scalar("slip", "m", "0 where it is open; else its slip since it closed plus CLOSED")
LAW = table.scalar("law", "", "history of the laws, from here on")
MIN_WIDTH = table.skip(3)

CLOSED = 1e-300
"""m: the slip of a contact that has not slipped yet, so that it differs from that of an open one."""
