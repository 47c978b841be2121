"""Python's collector of cycles, off while much is made that stays.

Imports, the compiler and a scene's bodies are a million objects with few cycles among them. The collector would go through all of
them again and again, and once more when the program ends: a third of a start.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_kept: set[str] = set()


@contextmanager
def paused(what: str) -> Iterator[None]:
    """No collection within. What is there at the end is never looked at again, but only the first time for each `what`: a
    program that makes a thousand simulations gets the memory of each back."""
    if not gc.isenabled():  # within another one, or its user wants none
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if what not in _kept:
            _kept.add(what)
            gc.freeze()
        gc.enable()
