"""Former name of what it imports; goes once no file uses it."""

from typing import Any

import numpy as np

from thirdbody.trajectory import summary
from thirdbody.trajectory.summary import NO_MAPS as NO_MAPS


def maps_of_cycles(run: Any, plate: str, cycles: float) -> dict[str, np.ndarray]:
    return summary.maps_of_cycles(run.drag, plate, cycles)
