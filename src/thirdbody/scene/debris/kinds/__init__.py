"""The built-in kinds of debris. A module here is a kind, with `KIND = ItsClass`; nothing else has to know of it."""
