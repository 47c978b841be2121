"""Former name of what it imports; goes once no file uses it."""

from thirdbody.api import Run as Run
from thirdbody.api import open_run as open_run
from thirdbody.trajectory.open_file import FILE_NAME as FILE_NAME
