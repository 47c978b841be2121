"""What `thirdbody check` says of a bed of debris: its inertial number, its softness, and at which speed it is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from thirdbody.granular_flow import LAYERS, inertia_verdict
from thirdbody.system.terminal import print_line
from thirdbody.units import duration, pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


def bed_report(built: Simulation) -> dict[str, Any] | None:
    """Return the numbers of a bed at the speed at which it is computed, estimated before the run; None where there is no bed.

    `inertial_number` is of the median diameter, `inertial_number_largest` of the largest; None where no pressure is known.
    """
    bed = built.bed
    if bed is None:
        return None
    faster = built.speed_scale.factor if built.speed_scale else 1.0
    number = faster * bed.inertial_number
    return {
        "layers": bed.layers,
        "median_diameter": bed.diameter,
        "largest_diameter": bed.largest_diameter,
        "pressure": _known(bed.pressure),
        "shear_rate": faster * bed.shear_rate,
        "inertial_number": _known(number),
        "inertial_number_largest": _known(number * bed.largest_diameter / bed.diameter),
        "softness": _known(bed.softness),
        "verdict": _verdict(bed.layers, number),
    }


def _verdict(layers: float, number: float) -> str:
    """Describe an inertial number that was estimated for debris of so many layers."""
    if layers < LAYERS:
        return f"no bed, but less than {LAYERS:g} layers: bodies roll and slide from plate to plate, whatever this number is"
    if math.isnan(number):
        return "inertial number unknown before the run: the plate is held at a gap, so the pressure is a result"
    if math.isinf(number):
        return "not quasi-static: the load falls to zero, where the speed decides"
    return inertia_verdict(number)


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def speed_report(built: Simulation, wall_time: float, step_time: float) -> dict[str, Any] | None:
    """Return both speeds of a scene that is computed at another one than it asks for; None for other scenes.

    `wall_time`, `step_time`: wall time of the run and its part for steps [s], of which a run at the speed asked for would take
    `scene_time` over `simulated_time` times as many. `requested_wall_time` is the wall time of that run.
    """
    scale = built.speed_scale
    if scale is None:
        return None
    time = built.scene_time(built.planned_time)
    requested = wall_time + step_time * (time / built.planned_time - 1.0)
    return scale.report() | {"scene_time": time, "requested_wall_time": requested}


def print_bed(report: Mapping[str, Any]) -> None:
    """Print what a report of `check` says of the bed and of the scaled speed."""
    if scale := report["speed_scale"]:
        wall = f"about {duration(report['estimated_wall_time'])} instead of {duration(scale['requested_wall_time'])}"
        print_line(f"speed: {scale['text']}; {wall}")
    if not (bed := report["bed"]):
        return
    print_line(
        f"debris of {bed['layers']:.1f} layers of {pretty(bed['median_diameter'], 'length')} (median diameter), {_numbers(bed)}"
        f"{bed['verdict']}"
    )


def _numbers(bed: Mapping[str, Any]) -> str:
    """Return the numbers of a bed whose pressure is known."""
    if bed["inertial_number"] is None or bed["softness"] is None:
        return ""
    return (
        f"inertial number {bed['inertial_number']:.2g} ({bed['inertial_number_largest']:.2g} of the largest body), softness "
        f"{bed['softness']:.2g} (overlaps about {1.0 / bed['softness']:.1g} of the radius); "
    )
