"""History of a candidate: frame and slip, history of the laws, memory of the labeller.

The laws have four columns or more. Most chains of laws need four numbers at most: a row is then one cache line.
"""

from thirdbody.kernels.columns.table import Table

table = Table("H", "a candidate contact")

AXIS, AXIS3 = table.vector("axis", 3, "", "first axis of its frame")
SLIP = table.scalar("slip", "m", "slip since it closed plus 1e-300 (CLOSED); 0 where it is open")
LAW = table.scalar("law", "", "history of the laws, from here on")
MIN_WIDTH = table.skip(3)

CLOSED = 1e-300
"""Slip of a contact that has not slipped yet [m], so that it differs from the 0 of an open one."""
