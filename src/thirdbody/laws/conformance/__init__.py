"""The conformance suite that laws, measures, effects and labellers must pass."""
