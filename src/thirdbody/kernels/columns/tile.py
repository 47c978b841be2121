"""Tiles, the blocks of contacts on which laws work: structure of arrays, TILE numbers per field."""

TILE = 64
"""Contacts per tile."""
