"""Former name of what it imports; goes once no file uses it."""

from thirdbody.export.tables import export_run as export_run
