"""The conformance suite that every contact law has to pass."""
