"""Bits of the column `forecast` of a labeller; reports compare them with what bodies then do."""

CAN_STICK, CAN_SLIDE, NO_FORECAST = 1, 2, 4
"""It can stick; it can slide along the drag; there is no forecast, as the body is not held from both plates, or by slopes."""
