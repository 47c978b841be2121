"""Former name of what it imports; goes once no file uses it."""

from thirdbody.system.processes import cores as cores
