"""Studies: many runs of one scene, and what can be learnt from them together."""
