"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.writer import static_arrays as static_arrays
