"""Debris: what a kind of debris is (`contract`), where kinds are found (`registry`), and the built-in ones (`kinds`)."""
