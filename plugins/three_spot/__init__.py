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

from thirdbody.plugin import COULOMB, HERTZ, HERTZ_DAMPING, MINDLIN, TANGENTIAL_DAMPING, Labeller, LawFamily, Plugin

from . import classify
from .exact import EXACT
from .mdr import MDR
from .support import FORECASTS, output

LABELLER = Labeller(
    name="three_spot", observe=classify.update_history, label=classify.label,
    label_without_effects=classify.label_without_effects, label_without_forecasts=classify.label_without_forecasts,
    states=classify.STATES, reasons=classify.REASONS, margins=classify.MARGINS, extras=classify.EXTRAS, codes=classify.CODES,
    forecasts=FORECASTS, outputs=output, memory=classify.MEMORY, contact_memory=classify.CONTACT_MEMORY,
    source="Willert, Self-consistency conditions in static three-body elastic tangential contact; labels by travel",
)  # fmt: skip

THREE_SPOT = LawFamily(
    name="three_spot",
    levels={
        "coulomb": (HERTZ, HERTZ_DAMPING, COULOMB, TANGENTIAL_DAMPING),
        "mindlin": (HERTZ, HERTZ_DAMPING, MINDLIN, TANGENTIAL_DAMPING),
        "mdr": (HERTZ, HERTZ_DAMPING, MDR, TANGENTIAL_DAMPING),
        "exact": (HERTZ, HERTZ_DAMPING, EXACT, TANGENTIAL_DAMPING),
    },
    default_level="mindlin",
    labeller=LABELLER,
    source="Willert, Self-consistency conditions in static three-body elastic tangential contact",
)

PLUGIN = Plugin(name="three_spot", families=(THREE_SPOT,), source=THREE_SPOT.source)
