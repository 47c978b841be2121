"""Former name of what it imports; goes once no file uses it."""

from thirdbody.export.tables import as_text as as_text
from thirdbody.export.tables import export_csv as export_csv
