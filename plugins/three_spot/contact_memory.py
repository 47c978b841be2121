"""Memory of the labeller for a loaded contact: columns behind those of `loaded_contact`."""

from thirdbody.plugin import Table, loaded_contact

table = Table("C, from MEMORY on", "a loaded contact of a body")

SLIP_REFERENCE = loaded_contact.MEMORY + table.scalar("slip_at_reference", "m", "slip at the reference")
SLIP_LAST = loaded_contact.MEMORY + table.scalar("slip_last_window", "m", "slip in the last closed window")
STAMP = loaded_contact.MEMORY + table.scalar("stamp", "", "number of the last observation in which it was loaded")
NAMES = table.names()
