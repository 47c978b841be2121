"""Report of `thirdbody check`: the resolved scene, its physics, its integrator, and the cost of a run."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from thirdbody.report.active_components import part_warnings, parts
from thirdbody.report.bed_report import bed_report, print_bed, speed_report
from thirdbody.report.integration_trial import expected_integration
from thirdbody.report.plates import plate_report, print_plate, print_rough_plates, rough_plates
from thirdbody.report.tables import table
from thirdbody.runner.frame_cost import FrameCost, frame_cost
from thirdbody.runner.run_warnings import run_warnings
from thirdbody.system.terminal import PrintableStream, print_line
from thirdbody.units import duration, file_size, pretty

if TYPE_CHECKING:
    from thirdbody.assembly.physics import CompiledPhysics
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.scene.model import Scene


class Check(dict[str, Any]):
    """Result of `check`, by name, in SI; `print` shows it as `thirdbody check` does."""

    def __str__(self) -> str:
        text = io.StringIO()
        with redirect_stdout(cast(Any, PrintableStream(text))):
            print_check(self)
        return text.getvalue()

    def __repr__(self) -> str:
        return f"<Check of '{self['title']}': {self['bodies']} bodies, {len(self['warnings'])} warning(s)>"


def check(
    scene: Scene | str | os.PathLike[str] | Mapping[str, Any], *, plugins: Iterable[str | Path] = (), force: bool = False
) -> Check:
    """Build a scene (as `run` does) and report its warnings, defaults, laws, time step, and the cost of a run.

    Parameters
    ----------
    scene, plugins, force
        As for `run`.

    Returns
    -------
    dict
        `warnings` first, then `title`, `scene`, `bodies`, `law`, `pairs`, `integrator`, `estimated_wall_time` [s], `memory` and
        `disk` [bytes] and more. Printed, it is the text of `thirdbody check`.

    Raises
    ------
    UsageError, InputError
        As for `run`.

    Examples
    --------
    >>> report = thirdbody.check("example.toml")
    >>> report["bodies"], report["law"]["level"]
    (4, 'mindlin')
    """
    from thirdbody.runner.prepare import check_call, prepare
    from thirdbody.scene.model import Scene

    check_call(plugins, force=force)
    result = check_report(prepare(Scene.of(scene, plugins), plugins, force))
    return Check({"warnings": result.pop("warnings")} | result)


def check_report(built: Simulation) -> dict[str, Any]:
    """Return the resolved scene as a dictionary: everything that `thirdbody check` reports, in SI.

    The trials advance the simulation itself, since a copy of a million bodies takes 2 GB: it cannot be run afterwards.
    """
    at_start, cautions = _report_at_start(built), [*built.warnings, *part_warnings(built)]
    from thirdbody.runner.output_schedule import planned_frames

    frames = _frames(built, planned_frames(built))
    integration, each = expected_integration(built), frame_cost(built)
    framing, disk = frames * each.seconds, each.first_bytes + (frames - 1) * each.bytes
    wall = integration["estimated_step_time"] + (0.0 if each.failure else framing)
    costs = run_warnings(built, wall, framing, disk, integration["trial_stopped"])
    return {
        **at_start,
        "speed_scale": speed_report(built, wall, integration["estimated_step_time"]),
        "estimated_wall_time": wall,
        **integration,
        "estimated_frame_time": framing,
        "frames": frames,
        "disk": disk,
        "warnings": [*costs, *_unmeasured(each), *cautions],
    }


def _report_at_start(built: Simulation) -> dict[str, Any]:
    """Return what is reported of the simulation as it starts."""
    from thirdbody.runner.simulate import debris_contact

    choice, state = built.choice, built.state
    return {
        "title": built.scene.title,
        "scene": built.requested.document(),
        "bodies": state.n_bodies,
        "spheres": state.n_spheres,
        "law": {
            "family": choice.family.name,
            "level": choice.level,
            "chain": [{"stage": law.stage, "law": law.name, "source": law.source} for law in choice.chain.laws],
            "not_needed": list(choice.off),
            "explicit_only": list(choice.chain.without_tangent),
        },
        "pairs": _pairs(choice),
        "parts": parts(built),
        "effects": {
            "on": [{"effect": effect.name, "source": effect.source} for effect in choice.other_effects],
            "debris_contact": debris_contact(built),
            "labels": built.labeller.name if built.labeller else "none",
        },
        "upper_plate": plate_report(built),
        "rough_plates": rough_plates(built),
        "bed": bed_report(built),
        "integrator": built.plan.kind,
        "integrator_reason": built.plan.reason,
        "settle": built.settle,
        "simulated_time": built.planned_time,
        "expected_overlap_over_radius": built.upper.shared_overlap,
        "initial_overlap": built.relaxed.document() if built.relaxed else None,
        "memory": memory_of(built),
    }


def _pairs(choice: CompiledPhysics) -> list[dict[str, Any]]:
    """Return the parameters of each pair of materials that can meet."""
    return [
        {
            "between": [pair.a.name, pair.b.name],
            "friction": pair.friction,
            "restitution": pair.restitution,
            **{
                f"{law.name}.{name}": value
                for law, values in zip(choice.chain.laws, row, strict=True)
                for name, value in zip(type(values)._fields, values, strict=True)
            },
        }
        for pair, row in zip(choice.pairs, choice.rows, strict=True)
    ]


def _frames(built: Simulation, planned: int) -> int:
    """Return the expected number of frames: as planned, but no more than one after every step."""
    if not built.integrator.divisible or built.scene.output.every >= built.shortest_interval:
        return planned
    by_time = built.scene.output.every_kind == "time"
    steps = (built.planned_time - (0.0 if by_time else built.settle)) / built.state.dt
    return min(planned, 2 + math.ceil(steps))


def _unmeasured(cost: FrameCost) -> list[str]:
    return [f"the time of frames is not in the estimate, a trial of some was not written: {cost.failure}"] if cost.failure else []


def memory_of(built: Simulation) -> int:
    """Return the bytes of all tables of a simulation: of its state, its candidates and its integrator; a table counts once.

    Where closed contacts only have rows, these are as many as are expected in a run.
    """
    tables = [_whole(each) for owner in (built.state, built.integrator) for each in _tables(owner)]
    expected = getattr(built.state.slots.rows, "expected_bytes", lambda bodies: 0)  # `ClosedRows` have them
    return sum({id(each): each.nbytes for each in tables}.values()) + expected(built.state.n_bodies)


def _tables(owner: object) -> Iterator[np.ndarray]:
    """Yield the arrays that an object holds: as attributes, in tuples, and in lists of candidates."""
    from thirdbody.engine.candidates import AllRows, Candidates

    for value in owner if isinstance(owner, tuple) else vars(owner).values():
        if isinstance(value, np.ndarray):
            yield value
        elif isinstance(value, tuple | Candidates | AllRows):
            yield from _tables(value)


def _whole(array: np.ndarray) -> np.ndarray:
    """Return the array whose memory a view shows."""
    return _whole(array.base) if isinstance(array.base, np.ndarray) else array


def print_check(report: dict[str, Any]) -> None:
    """Print the result of `check_report`: warnings, then the run and its cost, then the physics and the resolved scene."""
    from thirdbody.schema.write import toml_text

    for warning in report["warnings"]:
        print_line(f"warning: {warning}")
    print_line(f"# {report['title'] or 'scene'}: {report['bodies']} bodies, {report['spheres']} spheres")
    _print_costs(report)
    _print_integration(report)
    print_plate(report)
    print_rough_plates(report["rough_plates"])
    print_bed(report)
    _print_laws(report)
    print()
    print(toml_text(report["scene"]))
    if report["warnings"]:
        print(f"# {len(report['warnings'])} warning(s): see the top")


def _print_costs(report: dict[str, Any]) -> None:
    wall = report["estimated_wall_time"]
    wall_time = "wall time unknown (a guard stopped the trial)" if math.isnan(wall) else duration(wall)
    framing = report["estimated_frame_time"]
    frames = f"{report['frames']} frames" + ("" if math.isnan(framing) else f" (they take {duration(framing)} of it)")
    memory = f"{file_size(report['memory'])} of memory ({file_size(report['memory'] / report['bodies'])} a body)"
    print(f"estimated: {wall_time}, {memory}, {frames}, {file_size(report['disk'])} on disk")


def _print_laws(report: dict[str, Any]) -> None:
    law = report["law"]
    table(f"law {law['family']}, level {law['level']}", ("stage", "law", "source"),
          [(entry["stage"], entry["law"], entry["source"]) for entry in law["chain"]])  # fmt: skip
    if law["not_needed"]:
        print_line(f"absent, because no pair requires it: {', '.join(law['not_needed'])}")
    for pair in report["pairs"]:
        values = ", ".join(f"{name} {value:.6g}" for name, value in pair.items() if name != "between")
        print_line(f"pair {pair['between'][0]}/{pair['between'][1]}: {values}")
    on = ", ".join(effect["effect"] for effect in report["effects"]["on"]) or "none"
    if law["explicit_only"]:
        print_line(f"without a tangent, explicit integrator only: {', '.join(law['explicit_only'])}")
    contact, labels = report["effects"]["debris_contact"], report["effects"]["labels"]
    print_line(f"body effects: {on} (all others are absent); debris contact: {contact}; labels: {labels}")
    table("effects and components", ("part", "", "reason"),
          [(row["part"], "on" if row["on"] else "off", row["reason"]) for row in report["parts"]])  # fmt: skip


def _print_integration(report: dict[str, Any]) -> None:
    print_line(f"integrator {report['integrator']}: {report['integrator_reason']}")
    _print_expected(report)
    settling, whole = pretty(report["settle"], "time"), pretty(report["simulated_time"], "time")
    if "time_step" not in report:
        chosen = report["accuracy"]
        largest_step = chosen["largest_step"]
        maximum = f"{chosen['radii']:g} contact radii of the drag" + (
            "" if math.isinf(largest_step) else f" or {pretty(largest_step, 'length')}"
        )
        inertia = "with inertia" if chosen["inertia"] else "without inertia (quasi-static)"
        print(f"steps up to {maximum}, error at most {chosen['tolerance']:g} of a contact radius, {inertia}")
        if report["common_steps"]:
            stepping = "all bodies by common steps, since they carry one plate together"
        elif report["bodies_meet"]:
            stepping = "every body by steps of its own, those that could meet by common steps"
        else:
            stepping = "every body by steps of its own"
        print_line(f"settling {settling}, simulated {whole}, {stepping}")
        return
    step = report["time_step"]
    print(f"time step {pretty(step['step'], 'time')}, {_limit(step)} (Rayleigh time {pretty(step['rayleigh'], 'time')})")
    print(f"settling {settling}, simulated {whole}, {report['steps']:.3g} steps")


def _print_expected(report: dict[str, Any]) -> None:
    """Print the expected islands of debris that may meet, and the expected times of both integrators."""
    if islands := report["islands"]:
        stride = pretty(islands["stride"], "length")
        near = f"{100.0 * islands['fraction_of_bodies']:.0f} % of them could meet another within {stride} of sliding"
        size = f"{islands['mean']:.1f} bodies on average, at most about {islands['largest']}"
        print_line(f"bodies cover {islands['area_fraction']:.2f} of the area, {near}; expected islands: {size}")
    if times := report["expected_times"]:
        both = ", ".join(f"{name} about {duration(times[name])}" for name in ("implicit", "explicit"))
        print_line(f"steps, on one core: {both}")


def _limit(step: dict[str, Any]) -> str:
    if step["limited_by"] == "the scene":
        return "given by the scene"
    return f"limited by {step['limited_by']} of body {step['body']}"
