"""Pictures and films of a run, and the page for a browser."""
