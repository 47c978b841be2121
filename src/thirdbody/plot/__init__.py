"""The summary page of a run: matplotlib panels and their data."""

# Panels in the order of the page.
NAMES = (
    "friction", "loop", "states", "groups", "accommodation", "bed", "gap", "load", "debris_load", "energy", "velocity_profile",
    "solid_profile", "stress_profile", "states_profile", "utilisation", "normal_force",
)  # fmt: skip
