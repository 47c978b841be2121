"""What a measurement was made on."""

from typing import Any

from thirdbody.jit import cache_dir
from thirdbody.studies import machine_info as studies
from thirdbody.studies.machine_info import described

__all__ = ["described", "machine"]


def machine() -> dict[str, Any]:
    """Processor, cores that this process may use, load when asked, and versions; `sources` names the compiled sources."""
    report = studies.machine()
    del report["threads"]  # every benchmark tells its own
    report["versions"]["sources"] = cache_dir.folder().name
    return report
