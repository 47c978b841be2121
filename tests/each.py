"""One rule for many files as one test, which names every file that breaks it: thousands of tests cost more than the rules."""

from collections.abc import Callable, Iterable
from typing import TypeVar

Item = TypeVar("Item")


def each(items: Iterable[Item], name_of: Callable[[Item], str] = str) -> Callable[[Callable[[Item], None]], Callable[[], None]]:
    """Make a test of one item a test of all of them."""
    rows = list(items)
    assert rows

    def of_all(rule: Callable[[Item], None]) -> Callable[[], None]:
        def test() -> None:
            broken = []
            for item in rows:
                try:
                    rule(item)
                except AssertionError as error:
                    broken.append(f"{name_of(item)}: {error}")
            assert not broken, "\n".join(broken)

        test.__name__, test.__doc__ = rule.__name__, rule.__doc__
        return test

    return of_all
