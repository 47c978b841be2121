"""The scene: the checked model, reading with all faults at once, saving."""
