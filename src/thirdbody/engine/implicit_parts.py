"""Parts of an implicit step that few scenes need, compiled and called through pointers only where one does; scratch."""

import math
import threading
from functools import partial
from typing import Any

from thirdbody.engine.neighbours import update_closest_points
from thirdbody.engine.state import State
from thirdbody.jit.arguments import Packer, address
from thirdbody.kernels.implicit import books, pairs, rough, spots_part
from thirdbody.kernels.implicit.workspace import ADDRESSES, PART, SCRATCH, STAGE, UPDATE_MINIMA, make_scratch
from thirdbody.kernels.tables import surface_contact


def part_addresses(state: State) -> dict[str, int]:
    """Return the addresses of the parts that a state needs by their names in `workspace.KINDS`; 0 for others."""
    parts: dict[str, tuple[Any, Any]] = {"book_contacts": (books.book_contacts, books.BOOK)}
    parts |= {"write_contacts": (books.write_contacts, books.WRITE), "end_contact": (books.end_contact, books.END)}
    if state.world.debris_meets:
        parts["pairs_part"] = pairs.pairs_part, PART
    if state.world.rough:
        parts |= {"update_minima": (rough.update_minima, UPDATE_MINIMA), "rough_part": (rough.rough_part, PART)}
    if len(state.physics.interaction):
        parts["spots_part"] = spots_part.spots_part, PART
    return {name: address(*parts[name]) if name in parts else 0 for name in ADDRESSES}


def find_minima(state: State) -> None:
    """Find the contacts that spheres can have with rough plates within the first step."""
    if not state.world.rough:
        return
    state.slots.Q[:, surface_contact.SEARCHED] = math.inf
    update_closest_points(state, partial(rough.update_minima, STAGE.ACCEPT))


class ThreadScratch:
    """Scratch of each thread (`workspace.SCRATCH`)."""

    def __init__(self) -> None:
        self._sizes, self._packers = (1, 1, 1, 1), {}  # type: tuple[int, ...], dict[int, Packer]

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy: it makes its own."""
        return {"_sizes": self._sizes, "_packers": {}}

    def fit(self, sizes: tuple[int, ...]) -> None:
        """Provide for islands of at most so many bodies, pairs, numbers in the band, and candidates of a body."""
        if any(new > old for new, old in zip(sizes, self._sizes, strict=True)):
            self._sizes, self._packers = tuple(map(max, sizes, self._sizes)), {}

    def of_thread(self, context: Any) -> Any:
        """Return the packed scratch of this thread."""
        scratch = self._packers.get(threading.get_ident())
        if scratch is None:
            scratch = self._packers[threading.get_ident()] = Packer(SCRATCH)
            scratch(make_scratch(context, *self._sizes))
        return scratch(scratch.given)
