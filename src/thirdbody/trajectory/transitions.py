"""Changes of state between successive frames: body, old and new state, reason, time and position.

Frames record states, not events: a body that changed twice between two frames shows one change, or none. The output interval is
the resolution in time.
"""

import numpy as np

from thirdbody.trajectory.reader import Run
from thirdbody.trajectory.schema import POSITION


def state_transitions(run: Run) -> dict[str, np.ndarray]:
    """Return one row per change, ordered by frame, then by body; values of the frame that shows the new state.

    `frame` (T,), `time` (T,) [s], `distance` (T,) [m] slid by the plates (only if the run has that series), `body` (T,), `from`
    and `to` (T,) state codes, `reason` (T,) code of the reason for the new state, `position` (T, 3) [m]. Raises AttributeError
    when the run recorded no states.
    """
    states, reasons = run.states, run.reasons
    frame, body = np.nonzero(states[1:] != states[:-1])
    frame += 1
    table = {"frame": frame, "time": run.times[frame]}
    if "distance" in run.series:
        table["distance"] = run.series["distance"][frame]
    table |= {"body": body, "from": states[frame - 1, body], "to": states[frame, body], "reason": reasons[frame, body]}
    return table | {POSITION: _positions(run, frame, body)}


def _positions(run: Run, frame: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Return the positions (T, 3) [m], read only from the frames that show a change."""
    positions = np.empty((len(frame), 3))
    for number in np.unique(frame):
        rows = frame == number
        positions[rows] = run.array("clumps", POSITION, int(number))[body[rows]]
    return positions
