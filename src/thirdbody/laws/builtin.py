"""The built-in laws and effects, registered as an ordinary plug-in."""

from thirdbody.laws.body_effects import DAMPING, GRAVITY
from thirdbody.laws.contract import LawFamily, Plugin
from thirdbody.laws.coulomb import COULOMB
from thirdbody.laws.damping import HERTZ_DAMPING, TANGENTIAL_DAMPING
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.local_damping import LOCAL_DAMPING
from thirdbody.laws.mindlin import MINDLIN
from thirdbody.laws.rolling import ROLLING_RESISTANCE

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
