"""thirdbody: wear debris between two surfaces, particle by particle: sticking, sliding or rolling, and why.

    scene = thirdbody.Scene.load("scene.toml")
    result = thirdbody.run(scene, out="runs/scene")
    result.states, result.series["friction_coefficient"]

Names are imported when first used, so that importing the package costs nothing (PEP 562). Installed plug-ins may bring functions
of their own, as entry points of the group `thirdbody.functions`: `thirdbody.balance(file)` is one.
"""

from typing import TYPE_CHECKING, Any

from thirdbody import errors

if TYPE_CHECKING:
    from thirdbody.api import Run, compare, resume, run
    from thirdbody.api import open_run as open
    from thirdbody.report.scene_check import check
    from thirdbody.scene.model import Scene
    from thirdbody.sweeps import Sweep, sweep
    from thirdbody.version import __version__ as __version__

__all__ = ["Run", "Scene", "Sweep", "check", "compare", "errors", "open", "resume", "run", "sweep"]

_MODULES = {
    "Scene": ("scene.model", "Scene"),
    "Run": ("api", "Run"),
    "open": ("api", "open_run"),
    "check": ("report.scene_check", "check"),
    "compare": ("api", "compare"),
    "resume": ("api", "resume"),
    "run": ("api", "run"),
    "Sweep": ("sweeps", "Sweep"),
    "sweep": ("sweeps", "sweep"),
    "__version__": ("version", "__version__"),
}

FUNCTION_GROUP = "thirdbody.functions"


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        from importlib import import_module

        module, attribute = _MODULES[name]
        return getattr(import_module(f".{module}", __name__), attribute)
    for point in () if name.startswith("_") else _plugged():
        if point.name == name:
            return point.load()
    raise AttributeError(f"module 'thirdbody' has no attribute '{name}'")


def _plugged() -> Any:
    """Return the functions that installed plug-ins provide."""
    from importlib.metadata import entry_points  # a quarter of the start of a command

    return entry_points(group=FUNCTION_GROUP)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__", *(point.name for point in _plugged())])
