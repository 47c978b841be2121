"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.read_blocks import rows_of as rows_of
