"""Memory of freed tables that the process keeps for the next ones.

The C library returns large freed tables to the system, which fills new ones with zeros page by page. In a run of 100 000 bodies
that is a seventh of the time of a frame.
"""

import ctypes

# Parameters of `mallopt` (malloc.h of the GNU C library): free memory at the end of the heap above which it is returned; largest
# number of tables outside of the heap.
_TRIM_THRESHOLD, _MMAP_MAX = -1, -4


def keep_freed_memory() -> None:
    """Keep freed tables of this process for new ones from now on; with another C library than GNU's nothing changes."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, TypeError, AttributeError):
        return
    mallopt(_TRIM_THRESHOLD, 2**31 - 1)
    mallopt(_MMAP_MAX, 0)
