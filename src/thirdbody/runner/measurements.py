"""What a run measures beside its frames: samples between outputs, a bed, the largest peak pressure, sums of measures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.engine.candidates import AllRows
from thirdbody.engine.guards import Ledger
from thirdbody.engine.measures import body_amounts
from thirdbody.engine.state import State, table
from thirdbody.errors import InputError, nearest
from thirdbody.laws.hertz import yield_limit
from thirdbody.laws.measures import SUM
from thirdbody.runner.stops import settling_frames
from thirdbody.scene.model import Scene
from thirdbody.trajectory.accommodation import accommodation, has_accommodation
from thirdbody.trajectory.bed_measures import BedMeasures
from thirdbody.trajectory.contacts import FrameContacts
from thirdbody.trajectory.frame import FrameMaker, Selection
from thirdbody.trajectory.names import LOWER_PLATE, UPPER_PLATE
from thirdbody.trajectory.profiles import AXES, Profiler
from thirdbody.trajectory.sampling import IntervalMeans, Sampler, sample_of

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


def frame_maker(simulation: Simulation, ledger: Ledger) -> FrameMaker:
    """Return what makes the frames of a run, with its means over output intervals, the measures of its bed, its profiles."""
    state, integrator, labeller = simulation.state, simulation.integrator, simulation.labeller
    drag, profiler, bed, means = np.array([*integrator.drag, 0.0]), None, None, None
    if (profiles := simulation.scene.output.profiles) is not None:
        labels = (lambda: integrator.label()[:, 0]) if labeller else None
        profiler = Profiler(profiles.bins, AXES.index(profiles.axis), labels, labeller.states if labeller else ())
    if is_bed(simulation):
        assert simulation.bed is not None
        bed = BedMeasures(state, simulation.bed.modulus)
        samplers: dict[str, Sampler] = {"velocity": lambda state: state.bodies.velocity}
        if has_accommodation(state, drag):
            samplers["accommodation"] = partial(accommodation, drag)
        if profiler:
            samplers["profiles"] = profiler
        if simulation.plan.kind == "explicit":
            means = IntervalMeans(state, samplers, lambda: interval_length(simulation), lambda: _has_records(state))
    maker = FrameMaker(state, ledger, labeller, integrator.drag, means, bed, profiler)
    maker.scene_time = simulation.scene_time if simulation.speed_scale else None
    select_output(simulation.scene, maker)
    return maker


def _has_records(state: State) -> bool:
    """Return whether contacts have records. If not, as between the outputs of runs without labels, the next recorded step will
    write some."""
    slots = state.slots
    if len(slots.R) >= slots.count:
        return True
    slots.rows = AllRows(slots.H, table(slots.count, slots.R.shape[1]))
    return False


def select_output(scene: Scene, maker: FrameMaker) -> None:
    """Have frames hold what the scene has written. Raises InputError for arrays that the bodies do not have."""
    output = scene.output
    if output.arrays is not None:
        known = ["position", *maker.body_arrays()]
        what = "the bodies of this run have no array"
        unknown = [name for name in output.arrays if name not in known]
        if unknown:
            raise InputError([scene.fault(("output", "arrays"), f"{what} '{name}'; {nearest(name, known)}") for name in unknown])
    maker.selection = Selection(output.blocks, output.arrays, output.precision == "float32", output.compress)
    if output.sample is not None and output.sample < maker.state.n_bodies:
        maker.follow(sample_of(output.sample, maker.state.n_bodies))


def is_bed(simulation: Simulation) -> bool:
    """Return whether debris between two plates meets other debris, under a pressure without an edge."""
    searched = simulation.plan.kind == "explicit" or getattr(simulation.integrator, "meets", False)
    return simulation.bed is not None and simulation.state.world.lower is not None and searched


def interval_length(simulation: Simulation) -> float:
    """Return the expected length [s] of the output interval that begins now; infinite where its end is not reached.

    It does not depend on the length of the run, so that a run that is made longer later samples at the same instants.
    """
    state, output, settle = simulation.state, simulation.scene.output, simulation.settle
    if output.every_kind == "time":
        settling, spacing = settling_frames(simulation)
        return output.every * (spacing if state.time < settling * output.every else 1)
    if state.time < settle:
        return settle - state.time
    return simulation.schedule.time_of(state.distance + output.every, settle) - state.time


def measured_summary(simulation: Simulation) -> dict[str, Any]:
    """Return the entry `measures` of the summary: sums over the bodies, largest values of means and maxima; empty without any."""
    measures = simulation.state.physics.measures
    if measures is None:
        return {}
    amounts = body_amounts(simulation.state)
    return {"measures": {c.name: float(amounts[c.name].sum() if c.kind == SUM else amounts[c.name].max(initial=0.0))
                         for c in measures.layout.bodies}}  # fmt: skip


class PeakPressure:
    """Contact nearest to first yield, or farthest above it, over the frames of a run."""

    def __init__(self, simulation: Simulation) -> None:
        state, self.materials = simulation.state, simulation.choice.materials
        world, self.of_body = state.world, state.material[state.given]
        plates = {LOWER_PLATE: world.lower, UPPER_PLATE: None if world.upper is None else world.upper.material}
        self.of_plate = {side: material for side, material in plates.items() if material is not None}
        self.limits = np.array([[yield_limit(a, b).pressure for b in self.materials] for a in self.materials])
        self.ratio, self.pressure, self.pair, self.over = 0.0, 0.0, (0, 0), 0
        self.flows = state.physics.loss == "plastic"

    def export_state(self) -> dict[str, Any]:
        """Return what a checkpoint holds of it."""
        return {"ratio": self.ratio, "pressure": self.pressure, "pair": list(self.pair), "over": self.over}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from `export_state`. Raises KeyError, TypeError or ValueError."""
        self.ratio, self.pressure, self.over = float(state["ratio"]), float(state["pressure"]), int(state["over"])
        self.pair = (int(state["pair"][0]), int(state["pair"][1]))
        if not 0 <= min(self.pair) <= max(self.pair) < len(self.materials):
            raise ValueError(f"notes: pressure.pair is {self.pair}, expected numbers of {len(self.materials)} materials")

    def update(self, contacts: FrameContacts) -> None:
        """Update with the contacts of one frame."""
        pressure, partner = contacts.peak_pressure, contacts.partner
        if not len(pressure):
            return
        own, other = self.of_body[contacts.body], self.of_body[np.maximum(partner, 0)]
        for side, material in self.of_plate.items():
            other = np.where(partner == side, material, other)
        ratio = pressure / self.limits[own, other]
        worst = int(np.argmax(ratio))
        self.over = max(self.over, int(np.count_nonzero(ratio > 1.0)))
        self.pressure = max(self.pressure, float(pressure.max()))
        if ratio[worst] > self.ratio:
            self.ratio, self.pair = float(ratio[worst]), (int(own[worst]), int(other[worst]))

    def summary(self) -> dict[str, Any]:
        """Return largest peak pressure [Pa], largest ratio to first yield, that limit [Pa] or None, materials."""
        a, b = (self.materials[k] for k in self.pair)
        limit = yield_limit(a, b)
        finite = math.isfinite(limit.pressure)
        return {
            "peak_pressure": self.pressure,
            "first_yield": {
                "ratio": self.ratio,
                "pressure": limit.pressure if finite else None,
                "between": [a.name, b.name],
                "material": limit.material,
                "yield_strength": limit.strength if finite else None,
                "assumed": limit.assumed,
                "contacts": self.over,
                **({"flows": True} if self.flows else {}),
            },
        }
