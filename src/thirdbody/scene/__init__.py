"""The scene: checked model, reading (reports all faults at once), saving."""
