"""From a checked scene to a simulation that can be integrated."""
