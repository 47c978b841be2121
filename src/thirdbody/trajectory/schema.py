"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.names import BLOCKS as BLOCKS
from thirdbody.trajectory.names import Arrays as Arrays
from thirdbody.trajectory.names import Frame as Frame
