"""The scene: units, the checked model, reading and saving, and building the running simulation."""
