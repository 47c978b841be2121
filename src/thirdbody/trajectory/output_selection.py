"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.frame import ALL as ALL
from thirdbody.trajectory.frame import ALWAYS as ALWAYS
from thirdbody.trajectory.frame import CLUMPS as CLUMPS
from thirdbody.trajectory.frame import CONTACTS as CONTACTS
from thirdbody.trajectory.frame import SPHERES as SPHERES
from thirdbody.trajectory.frame import Selection as Selection
