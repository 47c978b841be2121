"""What a run measures beside its frames: samples between outputs, measures of a bed."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from thirdbody.engine.candidates import AllRows
from thirdbody.engine.state import State, table
from thirdbody.errors import InputError, nearest
from thirdbody.runner.output_schedule import settling_frames
from thirdbody.scene.model import Scene
from thirdbody.trajectory.accommodation import accommodation, has_accommodation
from thirdbody.trajectory.bed_measures import BedMeasures
from thirdbody.trajectory.frame import FrameMaker
from thirdbody.trajectory.interval_means import IntervalMeans, Sampler, body_velocities
from thirdbody.trajectory.output_selection import ALL, ALWAYS, Selection
from thirdbody.trajectory.profiles import AXES, Profiler
from thirdbody.trajectory.sample import sample_of

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


def interval_means(simulation: Simulation, profiler: Profiler | None = None) -> IntervalMeans | None:
    """Return the means that the outputs of a run need, None where they need none. `profiler`: that of `profiler_of`."""
    samplers = samplers_of(simulation)
    if samplers and profiler:
        samplers["profiles"] = profiler
    if not samplers:
        return None
    state = simulation.state
    return IntervalMeans(state, samplers, lambda: interval_length(simulation), lambda: has_records(state))


def has_records(state: State) -> bool:
    """Return whether contacts have records. If not, as between the outputs of runs without labels, the next recorded step will
    write some."""
    slots = state.slots
    if len(slots.R) >= slots.count:
        return True
    slots.rows = AllRows(slots.H, table(slots.count, slots.R.shape[1]))
    return False


def samplers_of(simulation: Simulation) -> dict[str, Sampler]:
    """Return the quantities to be sampled by name."""
    if not is_bed(simulation) or simulation.plan.kind != "explicit":
        return {}
    drag = np.array([*simulation.integrator.drag, 0.0])
    samplers: dict[str, Sampler] = {"velocity": body_velocities}
    return samplers | ({"accommodation": partial(accommodation, drag)} if has_accommodation(simulation.state, drag) else {})


def profiler_of(simulation: Simulation) -> Profiler | None:
    """Return the sampler of the profiles that a scene names, None where it names none."""
    profiles, labeller, integrator = simulation.scene.output.profiles, simulation.labeller, simulation.integrator
    if profiles is None:
        return None
    axis = AXES.index(profiles.axis)
    if labeller is None:
        return Profiler(profiles.bins, axis)
    return Profiler(profiles.bins, axis, lambda: integrator.label()[:, 0], labeller.states)


def selection_of(scene: Scene, maker: FrameMaker) -> Selection:
    """Return what of a frame the scene has written, and have `maker` make no more of it.

    Raises InputError for arrays that the bodies do not have.
    """
    output = scene.output
    known = ["position", *maker.body_arrays()] if output.arrays is not None else []
    unknown = [name for name in output.arrays or () if name not in known]
    if unknown:
        what = "the bodies of this run have no array"
        raise InputError([scene.fault(("output", "arrays"), f"{what} '{name}'; {nearest(name, known)}") for name in unknown])
    blocks = tuple(name for name in ALL if output.blocks is None or name in output.blocks)
    arrays = None if output.arrays is None else tuple(output.arrays)
    maker.blocks, maker.arrays = blocks, None if arrays is None else frozenset((*ALWAYS, *arrays))
    if output.sample is not None and output.sample < maker.state.n_bodies:
        maker.follow(sample_of(output.sample, maker.state.n_bodies))
    return Selection(blocks, arrays, output.precision == "float32", output.compress)


def is_bed(simulation: Simulation) -> bool:
    """Return whether debris between two plates meets other debris."""
    world = simulation.state.world
    searched = simulation.plan.kind == "explicit" or getattr(simulation.integrator, "meets", False)
    return world.debris_meets and world.lower is not None and world.upper is not None and searched


def bed_measures(simulation: Simulation) -> BedMeasures | None:
    """Return the measures of the bed of a run, None where it has none."""
    if not is_bed(simulation):
        return None
    assert simulation.bed is not None  # debris meets below an upper plate
    return BedMeasures(simulation.state, simulation.bed.modulus)


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
