"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.plates import PLATES as PLATES
