"""Checked TOML tables with units: types of fields, the base of all tables, reading and writing. No mechanics."""
