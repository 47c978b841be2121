"""Summary of a run: what it stored at its end, figures of its frames and of its maps, and a check of its energy."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from thirdbody.errors import InputError
from thirdbody.trajectory.bed import Bed, accommodation_fractions, bed_figures, bed_warning
from thirdbody.trajectory.drag import Drag
from thirdbody.trajectory.friction import Friction, friction_cycles
from thirdbody.trajectory.states import states_by_group

CLOSED = 1e-3
"""Largest residual, relative to the largest energy of the run, that is accepted."""

MAX_NUMERICAL_LOSS = 0.01
"""Largest numerical loss or gain of the implicit integrator, relative to the largest energy of the run, that is accepted."""

MUCH = 0.05
"""Fraction of the spent energy from which a line of the ledger is named as the likely cause."""

ROLLING = 0.02
"""Fraction of rolling bodies above which a warning says that inertia decides where they come to rest."""

NO_MAPS = "this run has no maps; [measures] with cell and a measure such as wear makes some"

MAX_CYCLES = 1e12


def run_summary(drag: Drag, friction: Friction, bed: Bed | None, stored: dict[str, Any] | None) -> dict[str, Any]:
    """Return the figures of a run with what it stored at its end, None for a run that did not get there (`RunFile.summary`)."""
    run = drag.run
    figures = _figures(drag, friction, bed) if run.frames else {"frames": 0}
    report = figures | {"finished": stored is not None} | (stored or {})
    rolling = run.series.get("fraction_rolling", ())
    if report.get("patches_not_carried") is not None and len(rolling):
        report["largest_fraction_rolling"] = float(np.max(rolling))
    verdict = energy_verdict(report, run.scene_tables.get("solver", {}))
    report |= {} if verdict is None else {"energy_verdict": verdict}
    rolled = report.get("largest_fraction_rolling", 0.0)
    much = (
        f"up to {100.0 * rolled:.0f} % of the bodies rolled or tipped at once, without inertia: where a body that tips "
        "comes to rest depends on its momentum, so some may end in another seat than with inertia, and the friction of "
        "few bodies may differ by some per cent"
    )
    at_end = verdict, bed_warning(bed), much if rolled > ROLLING else None
    return report | {"warnings": [*run.header.get("warnings", []), *report.get("warnings", []), *filter(None, at_end)]}


def _figures(drag: Drag, friction: Friction, bed: Bed | None) -> dict[str, Any]:
    run, series = drag.run, drag.run.series
    result: dict[str, Any] = {"frames": run.frames, "bodies": run.scene_bodies}
    if run.rows("clumps", 0) < run.scene_bodies:
        result["bodies_in_file"] = run.rows("clumps", 0)
    result["duration"] = float(run.times[-1] - run.times[0])
    if "distance" in series:
        result["distance"] = float(series["distance"][-1])
    if "scene_time" in series:
        result["speed_scale"] = run.header.get("speed_scale")
        result["scene_time"] = float(series["scene_time"][-1])
    if "friction_coefficient" in series:
        result["friction_coefficient"] = friction.value
        result["friction_coefficient_error"] = friction.error
        result["friction_verdict"] = friction.verdict
        if drag.stroke:
            result |= {"cycles": friction.cycles, "energy_per_cycle": friction.energy_per_cycle}
    for name in ("active", "load_share_debris"):
        if name in series:  # mean over the second half of the sliding, the last value where nothing slides
            frames = drag.second_half & np.isfinite(series[name])
            result[name] = float(series[name][frames].mean() if frames.any() else series[name][-1])
    if portions := accommodation_fractions(drag):
        result["accommodation"] = portions
    if bed is not None:
        result |= bed_figures(bed)
    if run.has_states and result["bodies"]:
        if "bodies_in_file" in result:
            result["fractions"] = {name: float(series[f"fraction_{name}"][-1]) for name in run.state_names}
        else:
            counts = np.bincount(run.bodies(-1)["state"], minlength=len(run.state_names))
            result["fractions"] = dict(zip(run.state_names, (counts / counts.sum()).tolist(), strict=False))
        result |= {f"{kind}s": rows for kind, rows in states_by_group(run).items()}
    return result


def energy_verdict(summary: Mapping[str, Any], solver: Mapping[str, Any]) -> str | None:
    """Return the error of a run's energy and its likely cause; None where the balance closes or is unknown.

    `summary`: what a run stored at its end. `solver`: that table of its scene.
    """
    residual, fraction = summary.get("energy_residual"), summary.get("energy_numerical_share") or 0.0
    report = []
    if residual is not None and residual > CLOSED:
        reason = _reason(summary, solver)
        report.append(f"energy balance open by {residual:.1e} of the largest energy (above {CLOSED:g}): {reason}")
    if abs(fraction) > MAX_NUMERICAL_LOSS:
        why = (
            "it damps impacts and oscillations that are faster than its steps; a smaller solver.tolerance resolves them, and "
            'where they are the question, solver.integrator = "explicit"'
        )
        if fraction < 0.0:
            why = (
                "steps are too long, or a contact law creates energy; a smaller solver.tolerance or solver.largest_step is needed"
            )
        elif solver.get("inertia") is False:
            why = (
                "without inertia nothing carries the energy that is set free where a body tips or a spot snaps, and it is lost "
                "at once; with solver.inertia = true dashpots and friction take it, in their own time"
            )
        lost = f"{'lost' if fraction > 0.0 else 'made'} {100.0 * abs(fraction):.1f} % of the energy (line `numerical`)"
        report.append(f"the implicit integrator itself {lost}: {why}")
    return "; ".join(report) or None


def _reason(summary: Mapping[str, Any], solver: Mapping[str, Any]) -> str:
    if summary.get("integrator") != "explicit":
        return "smaller steps are needed: a smaller solver.tolerance or solver.largest_step"
    step, smallest = summary.get("time_step"), (summary.get("time_step_limit") or {}).get("smallest")
    remedy = "take a smaller solver.time_step"
    if step and smallest:
        remedy = f'run again with solver.time_step = "{0.5 * min(step, smallest):.2g} s"'
        if solver.get("time_step", "auto") != "auto" and step > 1.001 * smallest:
            return f"the time step is {step / smallest:.2g} times the automatic one; {remedy}"
    damping, friction = (abs((summary.get("energy") or {}).get(name, 0.0)) for name in ("damping", "friction"))
    fraction = damping / max(damping + friction, 1e-300)
    if fraction > MUCH:
        return f"dashpots take {100.0 * fraction:.0f} % of what is lost and a step is too long for them; {remedy}"
    return f"a step is too long for some impact or contact; {remedy}"


def maps_of_cycles(drag: Drag, plate: str, cycles: float) -> dict[str, np.ndarray]:
    """Return the maps (n_y, n_x) of so many cycles by name, at the mean rate of the whole cycles without the first one.

    Raises InputError with fewer than two whole cycles, or for a number that cannot be.
    """
    if not 0.0 < cycles < MAX_CYCLES:
        raise InputError(f"cycles: {cycles:g} must be greater than 0 and below {MAX_CYCLES:g}")
    run, ends = drag.run, friction_cycles(drag)["end_time"]
    if len(ends) < 2:
        raise InputError(f"cycles: the run has {len(ends)} whole cycles; a rate needs two, of which the first does not count")
    before, after = (run.maps(plate, int(np.argmin(np.abs(run.times - end)))) for end in (ends[0], ends[-1]))
    return {name: cycles / (len(ends) - 1) * (after[name] - before[name]) for name in after}
