"""Arguments of functions that are gone: one message tells what does their job now."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from thirdbody.errors import UsageError

SEEDS = (
    "a run is computed by one process; more bodies, or a cluster, take a sweep over seeds: "
    "thirdbody sweep SCENE --vary debris.0.seed=1,2,3 (guide: On a cluster)"
)


P = ParamSpec("P")
R = TypeVar("R")


def without(**removed: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator of a function that has lost arguments; `removed`: what does their job, by name."""

    def decorator(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def checked(*given: P.args, **named: P.kwargs) -> R:
            for name in removed.keys() & named.keys():
                raise UsageError(f"{name}: {removed[name]}")
            return function(*given, **named)

        return checked

    return decorator
