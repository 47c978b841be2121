"""Codes of the partner of a contact, and of what a sphere can touch."""

LOWER, UPPER, DEBRIS = 0, 1, 2
"""Partners of a loaded contact."""

ONLY_LOWER, EVERYTHING, ONLY_UPPER = -1, 0, 1
"""What a sphere can touch (`engine.state.State.side`): a spot of a given particle touches one plate only."""
