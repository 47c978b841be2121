"""What a measurement was made on, and where it is printed."""

from typing import Any

from rich.console import Console
from thirdbody.jit import cache
from thirdbody.studies import timing as studies


def machine() -> dict[str, Any]:
    """Processor, cores that this process may use, load when asked, and versions; `sources` names the compiled sources."""
    report = studies.machine()
    del report["threads"]  # every benchmark tells its own
    report["versions"]["sources"] = cache.folder().name
    return report


def screen() -> Console:
    """The terminal as wide as it is; a file or a pipe, whose width is not known, wide enough for every table."""
    return Console() if Console().is_terminal else Console(width=150)


def head(console: Console) -> dict[str, Any]:
    report = machine()
    console.print(f"{studies.described(report)}, {report['cores']} cores, load {report['load']}")
    return report
