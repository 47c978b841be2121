"""Result of one variant of a study."""

import statistics
from dataclasses import dataclass, field

from thirdbody.studies.compare import Outcome
from thirdbody.studies.timing_statistics import Timing, timing
from thirdbody.studies.variants import Variant


@dataclass
class Row:
    """Result of one variant.

    `wall`, `cpu`: seconds of its repeats; `outcome`: None for a variant without result; `folder`: the folder of its run;
    `beside`: seconds of the scene's own variant, timed alternately with it.
    """

    variant: Variant
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    stable: bool = False
    message: str = ""
    integrator: str = ""
    step: float | None = None
    outcome: Outcome | None = None
    errors: dict[str, float] = field(default_factory=dict)
    folder: str = ""
    beside: list[float] = field(default_factory=list)

    @property
    def timing(self) -> Timing:
        """Cost of the variant [s of the processor], with its uncertainty."""
        return timing(self.cpu)

    @property
    def seconds(self) -> float:
        """Cost of the variant: median of the processor seconds over the repeats, NaN without any."""
        return self.timing.seconds

    @property
    def wall_seconds(self) -> float:
        """Median of the wall seconds over the repeats, NaN without any."""
        return statistics.median(self.wall) if self.wall else float("nan")
