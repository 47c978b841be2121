"""Kinds of debris: their contract (`contract`), the registry (`registry`), and one module per kind, with `KIND = ItsClass`."""
