"""Codes of what a contact is with, and of what a sphere can meet."""

LOWER, UPPER, DEBRIS = 0, 1, 2
"""Partners of a loaded contact."""

ONLY_LOWER, EVERYTHING, ONLY_UPPER = -1, 0, 1
"""What a sphere can meet (`sphere.SIDE`): a spot of a given particle meets one plate only."""
