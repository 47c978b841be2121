"""Path of the centre of a sphere since the last search for islands, in implicit runs with contact between bodies."""

from thirdbody.kernels.columns.table import Table

table = Table("paths", "a sphere")

LENGTH = table.scalar("length", "m", "length of the path, chord by chord")
LOW, LOW3 = table.vector("low", 3, "m", "lower corner of a box around the path")
HIGH, HIGH3 = table.vector("high", 3, "m", "upper corner of the box")
WIDTH = table.width
