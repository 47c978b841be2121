"""Former name of what it imports; goes once no file uses it."""

from thirdbody.system.processes import python_command as python_command
from thirdbody.system.processes import python_environment as python_environment
