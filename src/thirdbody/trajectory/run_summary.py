"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.states import state_counts as state_counts
