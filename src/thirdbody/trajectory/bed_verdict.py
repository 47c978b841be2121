"""Former name of what it imports; goes once no file uses it."""

from typing import Any

import numpy as np

from thirdbody.trajectory.bed import bed_rows as bed_rows


def steady(run: Any) -> np.ndarray:
    return np.asarray(run.drag.steady)
