"""The summary page of a run: matplotlib panels and their data."""
