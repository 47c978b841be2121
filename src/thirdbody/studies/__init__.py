"""Studies: many runs of one scene, compared: accuracy against time, effects."""
