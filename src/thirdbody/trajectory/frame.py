"""Frames of a trajectory from the state of a run, and what of them is written (table `output` of a scene).

Spheres that are not written follow from their bodies: the static arrays of their block then hold each sphere's place in its body.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from thirdbody.engine.guards import Ledger, Stored
from thirdbody.engine.measures import body_amounts, ejected, exits, map_densities
from thirdbody.engine.state import State, orientations
from thirdbody.kernels.tables import DEBRIS, body, body_extra, drive, patch, record, run_totals, sphere
from thirdbody.laws.contract import Labeller
from thirdbody.trajectory.accommodation import accommodation, has_accommodation, parts_of
from thirdbody.trajectory.bed_measures import BedMeasures
from thirdbody.trajectory.blocks import Storage
from thirdbody.trajectory.contacts import FrameContacts
from thirdbody.trajectory.names import SURFACE_WEAR, Frame
from thirdbody.trajectory.profiles import Profiler
from thirdbody.trajectory.read_blocks import LOCAL_CENTER
from thirdbody.trajectory.sampling import IntervalMeans, Sample


class FrameMaker:
    """Builder of frames; holds the impulses of the previous frame for means over the output interval.

    `means`: of what is sampled between the frames; None where nothing is. `bed`: measures of a bed; None without one. `profiler`:
    of the profiles; None without them.
    """

    def __init__(
        self, state: State, ledger: Ledger, labeller: Labeller | None, drag: np.ndarray, means: IntervalMeans | None = None,
        bed: BedMeasures | None = None, profiler: Profiler | None = None,
    ) -> None:  # fmt: skip
        self.means, self.bed, self.profiler = means, bed, profiler
        self.state, self.ledger, self.labeller, self.drag = state, ledger, labeller, np.array([*drag, 0.0])
        self.impulses = impulses_of(self.state)
        self.interval_means: dict[str, np.ndarray] = {}  # over the interval that ends with the last frame
        self.work_and_path = np.zeros(2)  # work [J] and path [m] of the drag in it
        self.interval = 0.0  # since the previous frame [s]
        self.scene_time: Callable[[float], float] | None = None  # time of the scene at a computed time, where they differ
        self.given, self.spheres = state.given, state.given_spheres
        self.selection = Selection()
        self.sample: Sample | None = None
        self.watch: Callable[[FrameContacts], None] | None = None  # gets all contacts of each frame, written or not

    def follow(self, sample: Sample) -> None:
        """Restrict frames to a sample of the bodies; series are those of all."""
        s, self.sample = self.state, sample
        self.spheres = self.spheres[sample.has(s.order[s.body[self.spheres]])]

    def static(self) -> dict[str, dict[str, np.ndarray]]:
        """Return the arrays that never change, by block."""
        s = self.state
        given = self.given if self.sample is None else self.given[self.sample.bodies]
        clumps = {
            "id": np.arange(len(given)),
            "population": s.population[given],
            "material": s.material[given],
            "mass": s.bodies.mass[given],
            "diameter": 2.0 * s.rayleigh_radius[given],
        }
        if self.sample is not None:
            clumps["scene_id"] = self.sample.bodies
        spheres = {
            "radius": s.spheres.radius[self.spheres], "id": np.arange(len(self.spheres)), "clump": self._bodies_of_spheres()
        }  # fmt: skip
        if not self.selection.has("spheres") and (self.selection.arrays is None or "quaternion" in self.selection.arrays):
            spheres[LOCAL_CENTER] = s.offsets[self.spheres]
        return {"spheres": spheres, "clumps": clumps}

    def _bodies_of_spheres(self) -> np.ndarray:
        number = self.state.order[self.state.body[self.spheres]]
        return number if self.sample is None else self.sample.row[number]

    def body_arrays(self) -> list[str]:
        """Return the names of the arrays of the bodies, without those that never change."""
        labels = np.zeros((self.state.n_bodies, 0)) if self.labeller else None
        return [name for name in self._arrays_of_bodies(labels, None) if name != "points"]

    def frame(self, labels: np.ndarray | None, stored: Stored | None = None) -> Frame:
        """Return the present frame, bodies in the order of the scene.

        `labels`: from `Explicit.label`; None without a labeller. `stored`: `engine.guards.stored_energies` of now, if known.
        """
        s, sample = self.state, self.sample
        self.interval_means = self.means.finish() if self.means else {}
        closed = FrameContacts(s)
        if self.watch is not None:
            self.watch(closed)
        arrays = self._arrays_of_bodies(labels, closed)
        chosen_arrays = self.selection.arrays
        clumps = {name: values() for name, values in arrays.items() if chosen_arrays is None or name in (*ALWAYS, *chosen_arrays)}
        series = self._series(clumps, closed, stored)
        chosen: Any = slice(None if self.selection.has("contacts") else 0)
        if sample is not None:
            clumps = {name: values[sample.bodies] for name, values in clumps.items()}
            chosen = (sample.has(closed.body) | sample.has(closed.partner)) & self.selection.has("contacts")
        contacts = closed.arrays(chosen) if sample is None else sample.of_contacts(closed.arrays(chosen))
        profiles = {}
        if self.profiler is not None:  # over the interval, of this instant where nothing is sampled between the frames
            mean = self.interval_means.get("profiles")
            profiles = self.profiler.profiles(self.profiler(s) if mean is None else mean, s)
        return Frame(s.time, self._spheres(clumps), clumps, contacts, self._plates(), series, profiles, self._maps())

    def _maps(self) -> dict[str, np.ndarray]:
        maps = map_densities(self.state)
        return maps | {SURFACE_WEAR: self.state.wear.depth} if self.state.wear else maps

    def _spheres(self, clumps: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        if not self.selection.has("spheres"):
            return {"points": np.zeros((0, 3))}
        s = self.state
        # a ball may share its row with its body
        velocity = s.B[:, body.VELOCITY3] if s.S is s.B else s.S[:, sphere.END_VELOCITY3]
        spheres = {"points": s.S[self.spheres, :3], "velocity": velocity[self.spheres]}
        if "state" in clumps:
            clump = self._bodies_of_spheres()
            spheres |= {name: clumps[name][clump] for name in ("state", "state_reason")}
        return spheres

    def _arrays_of_bodies(self, labels: np.ndarray | None, contacts: Any) -> dict[str, Callable[[], np.ndarray]]:
        """Return what computes the arrays of the bodies, by their names; `contacts`: FrameContacts, None for the names alone."""
        s, given = self.state, self.given
        arrays: dict[str, Callable[[], np.ndarray]] = {
            "points": lambda: s.B[given, body.POSITION3],
            "quaternion": lambda: orientations(s)[given],
            "velocity": lambda: s.B[given, body.VELOCITY3],
            "angular_velocity": lambda: s.B[given, body.SPIN3],
            "force": lambda: s.B[given, body.FORCE3],
            "torque": lambda: s.B[given, body.TORQUE3],
            "friction_work": lambda: s.B[given, body.FRICTION_WORK],
            "slip_distance": lambda: s.B[given, body.SLIP_DISTANCE],
            "utilisation": lambda: contacts.largest(contacts.utilisation),
            "peak_pressure": lambda: contacts.largest(contacts.peak_pressure),
            "contacts": lambda: contacts.number(),
        }
        if s.physics.loss:  # what the normal law has lost is in the kernel's work of friction
            arrays["friction_work"] = lambda: s.B[given, body.FRICTION_WORK] - s.E[given, body_extra.NORMAL_LOSS]
            arrays[f"{s.physics.loss}_work"] = lambda: s.E[given, body_extra.NORMAL_LOSS]
        arrays |= {name: partial(values.__getitem__, given) for name, values in body_amounts(s).items()}
        if (zone := s.world.zone) is not None:
            arrays["exit_position"] = lambda: exits(s, zone)[given, :2]
            arrays["exit_distance"] = lambda: exits(s, zone)[given, 2]
        if s.physics.pull_off is not None:
            arrays["agglomerate"] = self._agglomerates
        if labels is None or self.labeller is None:
            return arrays
        names = ("state", "state_reason", *(f"margin_{name}" for name in self.labeller.margins), *self.labeller.extras)
        codes = {"state", "state_reason", *self.labeller.codes}
        for k, name in enumerate(names):
            kind: Any = np.uint8 if name in codes else np.float64
            arrays[name] = partial(lambda column, kind: labels[given, column].astype(kind), k, kind)
        return arrays

    def _agglomerates(self) -> np.ndarray:
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        s, slots, n = self.state, self.state.slots, self.state.n_bodies
        assert s.physics.pull_off is not None
        on = np.flatnonzero((slots.histories.slip > 0.0) & (slots.sides == DEBRIS) & (slots.R[:, record.CONTACT_RADIUS] > 0.0))
        R = slots.R[on]
        on = on[R[:, record.NORMAL_FORCE] < s.physics.pull_off(slots.kind[on].astype(np.int64), R[:, record.EFFECTIVE_RADIUS])]
        i, j = s.order[s.body[slots.own[on]]], s.order[s.body[slots.partner[on]]]
        label = connected_components(coo_matrix((np.ones(len(on)), (i, j)), shape=(n, n)), directed=False)[1]
        lowest = np.full(n, n)
        np.minimum.at(lowest, label, np.arange(n))
        return lowest[label]

    def _plates(self) -> dict[str, np.ndarray] | None:
        world, (l_x, l_y) = self.state.world, self.state.world.size
        if world.lower is None:
            return None
        points, upper = np.array([[0.0, 0.0, 0.0], [l_x, 0.0, 0.0], [l_x, l_y, 0.0], [0.0, l_y, 0.0]]), world.upper
        if upper is not None:
            points = np.concatenate([points, points])
            points[4:, :2] += np.array(self.state.plate_displacement())
            points[4:, 2] = self._gap()
        return {"points": points}

    def _gap(self) -> float:
        """Return the height of the upper plate's surface [m]: common plate, else mean over patches, those inside a contact."""
        upper, heights = self.state.world.upper, self.state.P[:, patch.HEIGHT]
        if self.state.world.zone is not None:
            inside = self.state.P[:, patch.INSIDE] > 0.0
            return float(heights[inside].mean()) if inside.any() else np.nan
        return np.nan if upper is None else float(np.mean(heights) if upper.foundation is None else heights[-1])

    def _mean_forces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the mean force of the debris on both plates since the previous frame, and that of direct contact on the upper
        plate; at the first frame the present forces."""
        now, A = impulses_of(self.state), self.state.A
        change, self.impulses = now - self.impulses, now
        self.interval, self.work_and_path = float(change[0]), change[10:]
        if change[0] <= 0.0:
            return A[run_totals.UPPER_FORCE3].copy(), A[run_totals.LOWER_FORCE3].copy(), A[run_totals.DIRECT_FORCE3].copy()
        return change[1:4] / change[0], change[4:7] / change[0], change[7:10] / change[0]

    def _series(self, clumps: dict[str, np.ndarray], contacts: FrameContacts, stored: Stored | None) -> dict[str, Any]:
        s, states, plate = self.state, clumps.get("state"), self.state.world.upper
        upper, lower, direct = self._mean_forces()
        lines = self.ledger.lines(s, stored)
        both, dragged, friction = upper + direct, bool(np.any(self.drag)), np.nan
        work, path = self.work_and_path
        if dragged and abs(both[2]) > 0.0 and (plate is None or plate.schedule.straight):
            friction = -float(both @ self.drag) / abs(both[2])
        elif dragged and abs(both[2]) > 0.0 and path > 0.0:  # of a path that is no straight line, from its work and length
            friction = float(work) / (abs(float(both[2])) * float(path))
        series: dict[str, Any] = {
            "time": s.time,
            "distance": s.distance,
            # along the first direction of motion; the plate follows its schedule exactly in every step of both integrators
            "displacement": np.nan if plate is None else float(np.array(s.plate_displacement()) @ self.drag[:2]),
            "gap": self._gap(),
            "upper_force": upper,
            "lower_force": lower,
            "friction_coefficient": friction,
            "loaded": np.count_nonzero(contacts.number(contacts.normal_force != 0.0)),
        }
        if s.sprung:
            series["base_displacement"] = float(s.drive[drive.BASE2] @ self.drag[:2])
        if plate is not None:
            series["active"] = contacts.active()
        zone = s.world.zone
        if zone is not None or (plate is not None and plate.direct is not None):
            series |= {"direct_force": direct, "load_share_debris": float(upper[2] / both[2]) if both[2] > 0.0 else np.nan}
        if zone is not None:
            series |= {"inside": np.count_nonzero(s.P[:, patch.INSIDE] > 0.0), "ejected": np.count_nonzero(ejected(s, zone))}
        if s.world.walls:
            series["wall_force_near"], series["wall_force_far"] = contacts.wall_forces()
        if dragged:
            series["drag_work"] = s.A[run_totals.DRAG_WORK]
        if has_accommodation(s, self.drag):
            mean = self.interval_means.get("accommodation")
            series |= parts_of(accommodation(self.drag, s, contacts) if mean is None else mean)
        if s.wear:
            series |= s.wear.series()
        if self.scene_time is not None:
            series["scene_time"] = self.scene_time(s.time)
        if states is not None and self.labeller is not None:
            for code, name in enumerate(self.labeller.states):
                series[f"fraction_{name}"] = float(np.mean(states == code))
            if self.sample is not None:
                reasons = np.bincount(clumps["state_reason"], minlength=len(self.labeller.reasons))
                series |= {f"count_{name}": int(count) for name, count in zip(self.labeller.reasons, reasons, strict=False)}
        if self.bed is not None:
            pressure = 0.5 * (abs(upper[2]) + abs(lower[2])) / (s.world.size[0] * s.world.size[1])
            velocities = self.interval_means.get("velocity", s.bodies.velocity)
            elastic = lines["elastic_normal"] + lines["elastic_tangential"]
            series |= self.bed.series(pressure, velocities, series["gap"], elastic)
        return series | {f"energy_{name}": value for name, value in lines.items()}


def impulses_of(state: State) -> np.ndarray:
    """Return the time [s], the impulses since the start [N s], and work [J] and path [m] of the drag, (12,).

    Impulses are those of the debris on the upper and on the lower plate, and of direct contact on the upper one.
    """
    A = state.A
    impulses = A[run_totals.UPPER_IMPULSE3], A[run_totals.LOWER_IMPULSE3], A[run_totals.DIRECT_IMPULSE3]
    return np.concatenate([[A[run_totals.TIME]], *impulses, [A[run_totals.DRAG_WORK], A[run_totals.DISTANCE]]])


ALWAYS = ("points", "state", "state_reason")
"""Arrays of the bodies that are written whatever `output.arrays` says."""


class Selection(NamedTuple):
    """What of a frame is written, and how; `blocks` and `arrays` (of the bodies) None: all."""

    blocks: Sequence[str] | None = None
    arrays: Sequence[str] | None = None
    single: bool = False
    compress: bool = False

    def has(self, block: str) -> bool:
        """Return whether the spheres, or the contacts, are written; else their block is empty."""
        return self.blocks is None or block in self.blocks

    def storage(self, block: str) -> Storage:
        """Return how the arrays of a block are stored."""
        # float32 for the velocities of spheres: their motion follows from the clump's, which is stored in full precision
        return Storage(self.single or block == "spheres", self.single, self.compress and block in ("clumps", "spheres"))


EVERYTHING = Selection()
