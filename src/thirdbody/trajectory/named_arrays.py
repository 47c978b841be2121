"""Arrays by name; an unknown name raises an error with the nearest ones."""

import difflib
from collections.abc import Iterable
from typing import Any


class Named(dict[str, Any]):
    """Dictionary whose KeyError suggests the nearest names."""

    def __missing__(self, name: object) -> Any:
        raise unknown_name(name, self)


def unknown_name(name: object, known: Iterable[str]) -> KeyError:
    """Return the error for an unknown name: it suggests the nearest of the known ones, else lists all."""
    names = sorted(known)
    near = difflib.get_close_matches(str(name), names, 3, 0.5)
    offer = f"did you mean {' or '.join(map(repr, near))}?" if near else f"known: {', '.join(names)}"
    return KeyError(f"no {name!r}; {offer}")
