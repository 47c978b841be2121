"""One rung of a ladder as it came out."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field

from thirdbody.studies.compare import Outcome
from thirdbody.studies.timing_statistics import Timing, timing
from thirdbody.studies.variants import Variant


@dataclass
class Row:
    """One rung as it came out. `wall`, `cpu`: seconds of its repeats; `outcome`: None for a rung that gave nothing; `place`: the
    folder of its run, beside those of the other rungs; `beside`: seconds of the scene's own rung, in turns with it."""

    rung: Variant
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    stable: bool = False
    message: str = ""
    integrator: str = ""
    step: float | None = None
    outcome: Outcome | None = None
    errors: dict[str, float] = field(default_factory=dict)
    place: str = ""
    beside: list[float] = field(default_factory=list)

    @property
    def timing(self) -> Timing:
        """What the rung costs, seconds of the processor, and how well that is known."""
        return timing(self.cpu)

    @property
    def seconds(self) -> float:
        """What the rung costs: median of the processor's seconds over the repeats, NaN without any."""
        return self.timing.seconds

    @property
    def wall_seconds(self) -> float:
        """Median of the wall's seconds over the repeats, NaN without any."""
        return statistics.median(self.wall) if self.wall else float("nan")
