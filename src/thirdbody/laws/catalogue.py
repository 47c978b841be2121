"""The engine's own laws and effects, as an ordinary plug-in."""

from __future__ import annotations

from .body_effects import DAMPING, GRAVITY
from .contract import LawFamily, Plugin
from .coulomb import COULOMB
from .damping import HERTZ_DAMPING, TANGENTIAL_DAMPING
from .hertz import HERTZ
from .local_damping import LOCAL_DAMPING
from .mindlin import MINDLIN
from .rolling import ROLLING_RESISTANCE

PLUGIN = Plugin(
    name="catalogue",
    families=(
        LawFamily(
            name="hertz_mindlin",
            levels={
                "frictionless": (HERTZ, HERTZ_DAMPING),
                "coulomb": (HERTZ, HERTZ_DAMPING, COULOMB, TANGENTIAL_DAMPING),
                "mindlin": (HERTZ, HERTZ_DAMPING, MINDLIN, TANGENTIAL_DAMPING),
            },
            default_level="mindlin",
            source="Hertz 1882; Mindlin 1949",
        ),
    ),
    effects=(GRAVITY, DAMPING, LOCAL_DAMPING, ROLLING_RESISTANCE),
    source="thirdbody's catalogue",
)
