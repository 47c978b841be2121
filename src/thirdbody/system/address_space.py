"""Too little memory, or too little address space (`ulimit -v`, limits of batch systems), told in one line.

Without this libraries end the process by themselves, or fail to load with messages that blame an installation.
"""

from __future__ import annotations

from thirdbody.errors import ThirdbodyError

LEAST = 1024
"""MB that the compiled libraries need with two threads each (measured: 470 to run, 700 to compile, 900 to draw), and a reserve:
below, the compiler ends the process by itself."""

SHORT = ("cannot allocate memory", "failed to map segment", "unable to allocate", "bad_alloc")
"""What system, loader and numpy say in lower case when there is too little."""


class MemoryShortage(ThirdbodyError):
    """There is too little memory, or this process may use too little of it."""

    exit_code = 5


def require_address_space() -> None:
    """Raise MemoryShortage if this process may use less than the libraries need."""
    limit = _limit()
    if limit is not None and limit < LEAST:
        raise MemoryShortage(f"`ulimit -v` leaves {limit} MB of address space; at least {LEAST} MB are needed")


def memory_shortage(problem: BaseException) -> MemoryShortage | None:
    """Return the error for what failed for lack of memory, None for any other problem."""
    lines = [" ".join(line.split()) for line in str(problem).splitlines()]
    telling = [line for line in lines if any(words in line.lower() for words in SHORT)]
    report = telling and isinstance(problem, ImportError | OSError | RuntimeError)
    if not report and not isinstance(problem, MemoryError):
        return None
    text = (telling or lines or [""])[-1]
    return MemoryShortage(f"not enough memory{f' ({text[:200]})' if text else ''}{limit_hint()}")


def limit_hint() -> str:
    """Return words that tell the limit, for the end of a message; none without a limit."""
    limit = _limit()
    return "" if limit is None else f"; `ulimit -v` leaves {limit} MB of address space"


def _limit() -> int | None:
    """Return the MB of address space that this process may use, None without a limit."""
    try:
        import resource
    except ImportError:  # no such limits here
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit // 2**20
