"""Python's cyclic garbage collector, paused while many lasting objects are created.

Imports, the compiler and a scene's bodies are a million objects with few cycles among them. The collector would traverse all of
them repeatedly, and once more when the program ends: a third of a start.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_frozen: set[str] = set()


@contextmanager
def paused(what: str) -> Iterator[None]:
    """Pause the collector within the block, and exempt the objects alive at its end from collection.

    The exemption applies only the first time for each `what`: a program that makes a thousand simulations gets the memory of each
    back.
    """
    if not gc.isenabled():  # nested, or disabled by the user
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if what not in _frozen:
            _frozen.add(what)
            gc.freeze()
        gc.enable()
