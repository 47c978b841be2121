"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.blocks import Block as Block
from thirdbody.trajectory.blocks import Storage as Storage
