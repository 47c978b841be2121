"""How a rolling patch forgets: the option that the laws of partial slip share."""

from thirdbody.plugin import Option

RENEWAL = Option(
    "renewal",
    "dimensionless",
    2.0,
    low=0.0,
    high=100.0,
    doc="rate at which a rolling patch renews its material, per contact radius of way; 0 keeps the history in the patch",
)
"""The share of a disc that is still the same material falls by .64 per contact radius of way at first and to nothing after two.
An exponential of rate 2 stands for it: 2 % are left after two radii. Fresh material enters unloaded."""
