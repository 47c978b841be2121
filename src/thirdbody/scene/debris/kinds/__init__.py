"""The built-in kinds of debris. One module per kind, with `KIND = ItsClass`."""
