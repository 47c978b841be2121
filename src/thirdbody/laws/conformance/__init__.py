"""The conformance suite that every contact law must pass."""
