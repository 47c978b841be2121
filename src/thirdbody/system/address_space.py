"""Errors of too little memory or address space (`ulimit -v`, limits of batch systems), reported in one line.

Otherwise libraries terminate the process, or fail to load with messages that blame the installation.
"""

from thirdbody.errors import ThirdbodyError

MIN_ADDRESS_SPACE = 1024
"""Smallest address space [MB]: below it the compiler terminates the process.

The compiled libraries need it with two threads each (measured: 470 to run, 700 to compile, 900 to draw), with a reserve."""

SHORT = ("cannot allocate memory", "failed to map segment", "unable to allocate", "bad_alloc")
"""Phrases, in lower case, of system, loader and numpy for too little memory."""


class MemoryShortage(ThirdbodyError):
    """There is too little memory, or the limit of this process is too low."""

    exit_code = 5


def require_address_space() -> None:
    """Raise MemoryShortage if the limit of this process is below what the libraries need."""
    limit = _limit()
    if limit is not None and limit < MIN_ADDRESS_SPACE:
        raise MemoryShortage(f"`ulimit -v` leaves {limit} MB of address space; at least {MIN_ADDRESS_SPACE} MB are needed")


def memory_shortage(problem: BaseException) -> MemoryShortage | None:
    """Return the error for an exception caused by lack of memory, None for any other exception."""
    lines = [" ".join(line.split()) for line in str(problem).splitlines()]
    informative = [line for line in lines if any(words in line.lower() for words in SHORT)]
    report = informative and isinstance(problem, ImportError | OSError | RuntimeError)
    if not report and not isinstance(problem, MemoryError):
        return None
    text = (informative or lines or [""])[-1]
    return MemoryShortage(f"not enough memory{f' ({text[:200]})' if text else ''}{limit_hint()}")


def limit_hint() -> str:
    """Return the limit in words, for the end of a message; empty without a limit."""
    limit = _limit()
    return "" if limit is None else f"; `ulimit -v` leaves {limit} MB of address space"


def _limit() -> int | None:
    """Return the limit of the address space of this process [MB], None without a limit."""
    try:
        import resource
    except ImportError:  # no such limits here
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit // 2**20
