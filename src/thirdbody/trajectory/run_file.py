"""Run read from its file: its arrays, and what is computed from them; `thirdbody.api.Run` draws and exports it."""

from functools import cached_property
from typing import Any

import numpy as np

from thirdbody.trajectory.bed import Bed, bed_of
from thirdbody.trajectory.drag import Drag
from thirdbody.trajectory.friction import Friction, friction_cycles, friction_of
from thirdbody.trajectory.names import MAP_STATISTICS, PLATES, POSITION, SUMMARY_TEXT
from thirdbody.trajectory.open_file import damage_as_fault
from thirdbody.trajectory.run_arrays import RunArrays
from thirdbody.trajectory.summary import maps_of_cycles, run_summary


class RunFile(RunArrays):
    """A run, read from its file on demand; `api.Run`, which also draws and exports, documents it."""

    @cached_property
    def drag(self) -> Drag:
        """Motion of the upper plate: displacement, turns, whole cycles of a stroke."""
        return Drag(self, self._steady("", self._stored_summary))

    @cached_property
    def friction(self) -> Friction:
        """Friction coefficient of the run: `value`, `error`, `verdict` on whether it is stationary, and more."""
        with damage_as_fault(self.path, "the series of friction"):
            return friction_of(self.drag)

    @cached_property
    def bed(self) -> Bed | None:
        """Measures of the bed over the steady part: `means`, `errors`, `verdict` on whether shear is slow; None without one."""
        with damage_as_fault(self.path, "the series of the bed"):
            return bed_of(self.drag)

    @cached_property
    def cycles(self) -> dict[str, np.ndarray]:
        """Energy and extremes of the whole cycles of a stroke by name, one value per cycle (n,); n is 0 without a stroke.

        Names and units: `trajectory.friction.friction_cycles`.
        """
        with damage_as_fault(self.path, "the series of friction"):
            return friction_cycles(self.drag)

    @cached_property
    def warnings(self) -> list[str]:
        """Warnings before the run and at its end, as the command line prints them."""
        return list(self.summary()["warnings"])

    def map_statistics(self, cycles: float | None = None, frame: int = -1) -> dict[str, np.ndarray]:
        """Return depth, area and volume of the wear of the plates in numbers, and likewise of every map.

        Parameters
        ----------
        cycles : float, optional
            Of so many cycles of a stroke, at the mean rate of the whole cycles without the first one: an extrapolation, as the
            shapes of bodies do not change. None: since the start of the run.
        frame : int, where `cycles` is None; negative ones count from the end

        Returns
        -------
        dict of str to ndarray
            One row per plate and map: plate, map, mean, percentile_95 and largest [unit] of the cells that have any, unit,
            area_fraction of these cells, total over the plate [total_unit], such as the worn volume, total_unit. No rows in a run
            without maps.

        Raises
        ------
        InputError
            `cycles` is given, and the run has fewer than two whole ones.
        IndexError
            There is no such frame.
        """
        rows = list[tuple[Any, ...]]()
        for plate in PLATES if self.map_units else ():
            size = self.header["domain"]["size"]
            maps = self.maps(plate, frame) if cycles is None else maps_of_cycles(self.drag, plate, cycles)
            for name, values in maps.items():
                unit, covered = self.map_units[name], values[values > 0.0]
                numbers = (covered.mean(), np.percentile(covered, 95.0), covered.max()) if len(covered) else (0.0, 0.0, 0.0)
                total, of = float(values.mean()) * size[0] * size[1], {"m": "m3", "J/m2": "J"}.get(unit, f"{unit} m2")
                rows.append((plate, name, *numbers, unit, len(covered) / values.size, total, of))
        columns = zip(*rows, strict=True) if rows else ((),) * len(MAP_STATISTICS)
        return {name: np.array(values, object if isinstance((*values, 0)[0], str) else float)
                for name, values in zip(MAP_STATISTICS, columns, strict=True)}  # fmt: skip

    def transitions(self) -> dict[str, np.ndarray]:
        """Return the changes of state between frames, by frame, then by body.

        Frames record states, not events: a body that changed twice between two frames shows one change, or none.

        Returns
        -------
        dict of str to ndarray
            One row per change, with values of the frame that shows the new state: frame, time [s], distance [m] (if the run has
            that series), body, from, to, reason (codes), position (n, 3) [m].

        Raises
        ------
        AttributeError
            The run recorded no states.
        """
        states = self.states
        frame, body = np.nonzero(states[1:] != states[:-1])
        frame += 1
        table = {"frame": frame, "time": self.times[frame]}
        if "distance" in self.series:
            table["distance"] = self.series["distance"][frame]
        table |= {"body": body, "from": states[frame - 1, body], "to": states[frame, body], "reason": self.reasons[frame, body]}
        positions = np.empty((len(frame), 3))
        for number in np.unique(frame):  # only the frames that show a change are read
            rows = frame == number
            positions[rows] = self.array("clumps", POSITION, int(number))[body[rows]]
        return table | {POSITION: positions}

    def summary(self) -> dict[str, Any]:
        """Return the summary that the run stored at its end, and figures computed from its frames.

        Returns
        -------
        dict
            Numbers, texts and lists by name; figures whose series the run lacks are absent.

        Notes
        -----
        `warnings`: those of `Run.warnings`. From the frames: `finished` (False when the run was killed, interrupted or stopped by
        a guard; then `stopped` may give the reason), `frames`, `bodies`, `duration` [s], `distance` [m],
        `friction_coefficient`, `friction_coefficient_error` and `friction_verdict` (value, error and verdict of `friction`),
        for strokes `cycles` and `energy_per_cycle` [J],
        `accommodation` (fractions of the plate's path taken up by `upper_slip`, `lower_slip`, `rolling` and `shear`, over the
        second half of the sliding or of the cycles), `fractions` (state name to fraction of the bodies, last frame), and the
        same by `populations`, `materials` and `sizes` (lists from `trajectory.states.states_by_group`). Of a bed the means
        of its series over the steady part (`inertial_number`, `softness`, `solid_fraction`, ...) and their errors
        (`inertial_number_error`, ...), `quasi_static` (true or false), `bed_verdict` and `softness_verdict` (texts).

        Of a finished run also what it stored, such as `energy_residual` (relative), `energy_verdict` (likely reason, only where
        the residual or the numerical loss or gain is too large), `peak_pressure` (largest over contacts and frames [Pa]),
        `first_yield` (its `ratio` to the pressure at first yield; whether the yield strength is `assumed`),
        `energy_numerical_share` (loss by the implicit integrator, negative for a gain, divided as the residual), `load_ratio`
        (mean force on the upper plate over its load, last interval), for implicit runs `steps_limited_by` (cause to number of
        steps), and for quasi-static ones `patches_not_carried` (number at the end) and `largest_fraction_rolling` (over all
        frames).
        """
        with damage_as_fault(self.path, "its summary"):
            return run_summary(self.drag, self.friction, self.bed, self._steady("", self._stored_summary))

    def _stored_summary(self) -> dict[str, Any] | None:
        return dict(self._text(SUMMARY_TEXT)) if SUMMARY_TEXT in self._scene else None
