"""The three-spot Hertz-Mindlin contact of an irregular particle between two elastic half-spaces, and its labels.

Source: E. Willert, Self-consistency conditions in static three-body elastic tangential contact. An ordinary plug-in: it imports
nothing of the engine but `thirdbody.plugin`. A level is a preset: one law for each stage.

| level | tangential law | neglects |
|---|---|---|
| coulomb | elastic-plastic spring with a slip scale | tangential elasticity |
| mindlin | no-slip stiffness, with a memory that load cycles do not wear away | partial slip |
| mdr | a row of `springs` in the contact area, each with its limit | discretisation: the error falls with the springs |
| exact | the field of such springs in closed form between turning points, on curves 72 of them | nothing on slip along one line |
"""

from thirdbody.plugin import COULOMB, HERTZ, HERTZ_DAMPING, MINDLIN, TANGENTIAL_DAMPING, LawFamily, Plugin

from .classify import LABELLER
from .exact import EXACT
from .mdr import MDR

THREE_SPOT = LawFamily(
    name="three_spot",
    levels={law.name: (HERTZ, HERTZ_DAMPING, law, TANGENTIAL_DAMPING) for law in (COULOMB, MINDLIN, MDR, EXACT)},
    default_level="mindlin",
    labeller=LABELLER,
    source="Willert, Self-consistency conditions in static three-body elastic tangential contact",
)

PLUGIN = Plugin(name="three_spot", families=(THREE_SPOT,), source=THREE_SPOT.source)
