"""The tiles in which laws take their contacts: tables in columns, one field after the other, TILE numbers each."""

TILE = 64
"""Contacts per tile."""
