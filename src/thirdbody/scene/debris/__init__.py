"""Kinds of debris: their contract (`contract`), the registry (`registry`) and the built-in kinds (`kinds`)."""
