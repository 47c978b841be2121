"""Report of `thirdbody check`: the resolved scene, its physics, its integrator, and the cost of a run."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.granular_flow import LAYERS, inertia_verdict
from thirdbody.kernels.tables import patch
from thirdbody.report.tables import Report, table
from thirdbody.runner.outlook import memory_of, outlook
from thirdbody.runner.simulate import check_call, debris_contact, prepare
from thirdbody.scene.model import Scene
from thirdbody.schema.write import toml_text
from thirdbody.system.terminal import print_line
from thirdbody.units import duration, file_size, pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


class Check(Report):
    """Result of `check`, by name, in SI; `print` shows it as `thirdbody check` does."""

    def show(self) -> None:
        """Print it."""
        print_check(self)

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
    check_call(plugins, force=force)
    result = check_report(prepare(Scene.of(scene, plugins), plugins, force))
    return Check({"warnings": result.pop("warnings")} | result)


def check_report(built: Simulation) -> dict[str, Any]:
    """Return the resolved scene as a dictionary: everything that `thirdbody check` reports, in SI.

    Trials advance the simulation (`runner.outlook`): it cannot be run afterwards.
    """
    expected = built.expected
    at_start, warnings = _report_at_start(built, expected.parts()), [*built.warnings, *expected.warnings()]
    costs = outlook(built)
    return {**at_start, **costs, "warnings": [*costs["warnings"], *warnings]}


def _report_at_start(built: Simulation, parts: list[dict[str, Any]]) -> dict[str, Any]:
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
        "pairs": [
            {"between": [pair.a.name, pair.b.name], "friction": pair.friction, "restitution": pair.restitution}
            | {
                f"{law.name}.{name}": value
                for law, values in zip(choice.chain.laws, row, strict=True)
                for name, value in zip(type(values)._fields, values, strict=True)
            }
            for pair, row in zip(choice.pairs, choice.rows, strict=True)
        ],
        "parts": parts,
        "effects": {
            "on": [{"effect": effect.name, "source": effect.source} for effect in choice.other_effects],
            "debris_contact": debris_contact(built),
            "labels": built.labeller.name if built.labeller else "none",
        },
        "upper_plate": _plate(built),
        "rough_plates": {side: scales.document() for side, scales in built.surface_scales.items()},
        "bed": _bed(built),
        "integrator": built.plan.kind,
        "integrator_reason": built.plan.reason,
        "settle": built.settle,
        "simulated_time": built.planned_time,
        "expected_overlap_over_radius": built.upper.shared_overlap,
        "initial_overlap": asdict(built.relaxed) if built.relaxed else None,
        "memory": memory_of(built),
    }


def _plate(built: Simulation) -> dict[str, Any] | None:
    upper = built.state.world.upper
    if upper is None:
        return None
    founded, direct, area = upper.foundation, upper.direct, built.scene.domain.size[0] * built.scene.domain.size[1]
    load = float(upper.load.max()) if founded is None else founded.load
    return {
        "patches": len(upper.heights),
        "load": load,
        "support": built.scene.plates.upper.support if built.scene.plates.upper else "none",
        "free": upper.free if founded is None else founded.free,
        "mass": float(upper.mass.mean()),
        "damping": float(upper.damping.mean()),
        "dashpot_over_load": float(upper.damping.max()) * upper.schedule.top_speed() / load if load and founded is None else None,
        "gap": float(upper.heights.mean()),
        "moves": upper.schedule.moves,
        "largest_load": upper.schedule.largest_load() * float(upper.table()[:, patch.NOMINAL_LOAD].max()),
        "loaded_at_once": built.upper.loaded,
        "foundation": None if founded is None else founded.stiffness,
        "preload": 0.0 if founded is None else float(upper.load.max()),
        "contact": None
        if upper.zone is None
        else {
            "load": upper.zone.load,
            "half_width": upper.zone.half_width,
            "peak_pressure": upper.zone.peak,
            "friction": upper.zone.friction,
            "approach_scale": None if math.isinf(upper.zone.approach_scale) else upper.zone.approach_scale,
            "height_over_approach": float((upper.heights - upper.zone.gaps).max()) / upper.zone.approach_scale,
        },
        "direct_contact": None
        if direct is None
        else {
            "pressure_at_zero_gap": direct.prefactor / area,
            "u0": direct.length,
            "friction": direct.friction,
            "gap_without_debris": direct.gap(load),  # at which it alone carries the load
        },
    }


def _bed(built: Simulation) -> dict[str, Any] | None:
    """Return the numbers of a bed at the speed at which it is computed, estimated before the run; None where there is no bed.

    `inertial_number` is of the median diameter, `inertial_number_largest` of the largest; None where no pressure is known.
    """
    bed = built.bed
    if bed is None:
        return None
    known = lambda value: value if math.isfinite(value) else None  # noqa: E731
    faster = built.speed_scale.factor if built.speed_scale else 1.0
    number = faster * bed.inertial_number
    if bed.layers < LAYERS:
        verdict = f"no bed, but less than {LAYERS:g} layers: bodies roll and slide from plate to plate, whatever this number is"
    elif math.isnan(number):
        verdict = "inertial number unknown before the run: the plate is held at a gap, so the pressure is a result"
    else:
        zero = "not quasi-static: the load falls to zero, where the speed decides"
        verdict = zero if math.isinf(number) else inertia_verdict(number)
    return {
        "layers": bed.layers,
        "median_diameter": bed.diameter,
        "largest_diameter": bed.largest_diameter,
        "pressure": known(bed.pressure),
        "shear_rate": faster * bed.shear_rate,
        "inertial_number": known(number),
        "inertial_number_largest": known(number * bed.largest_diameter / bed.diameter),
        "softness": known(bed.softness),
        "verdict": verdict,
    }


def print_check(report: dict[str, Any]) -> None:
    """Print the result of `check_report`: warnings, then the run and its cost, then the physics and the resolved scene."""
    for warning in report["warnings"]:
        print_line(f"warning: {warning}")
    print_line(f"# {report['title'] or 'scene'}: {report['bodies']} bodies, {report['spheres']} spheres")
    _print_costs(report)
    _print_integration(report)
    _print_plate(report)
    print_rough_plates(report["rough_plates"])
    _print_bed(report)
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
    if islands := report["islands"]:
        stride = pretty(islands["stride"], "length")
        near = f"{100.0 * islands['fraction_of_bodies']:.0f} % of them could meet another within {stride} of sliding"
        size = f"{islands['mean']:.1f} bodies on average, at most about {islands['largest']}"
        print_line(f"bodies cover {islands['area_fraction']:.2f} of the area, {near}; expected islands: {size}")
    if times := report["expected_times"]:
        both = ", ".join(f"{name} about {duration(times[name])}" for name in ("implicit", "explicit"))
        print_line(f"steps, on one core: {both}")
    settling, whole = pretty(report["settle"], "time"), pretty(report["simulated_time"], "time")
    if "time_step" not in report:
        chosen = report["accuracy"]
        maximum = f"{chosen['radii']:g} contact radii of the drag"
        maximum += "" if math.isinf(chosen["largest_step"]) else f" or {pretty(chosen['largest_step'], 'length')}"
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
    limit = f"limited by {step['limited_by']} of body {step['body']}"
    limit = "given by the scene" if step["limited_by"] == "the scene" else limit
    print(f"time step {pretty(step['step'], 'time')}, {limit} (Rayleigh time {pretty(step['rayleigh'], 'time')})")
    print(f"settling {settling}, simulated {whole}, {report['steps']:.3g} steps")


def _print_plate(report: dict[str, Any]) -> None:
    plate = report["upper_plate"]
    if plate is None:
        return
    load = f"load {pretty(plate['load'], 'force')}" if plate["free"] else "height prescribed"
    load += f", at most {pretty(plate['largest_load'], 'force')}" if plate["largest_load"] > plate["load"] else ""
    if plate["preload"]:
        total = plate["preload"] * plate["patches"]
        load += f" and {pretty(plate['preload'], 'force')} of preload on each patch ({pretty(total, 'force')} more in all)"
    carried = f", carried by {plate['loaded_at_once']} of {report['bodies']} bodies at once" if plate["loaded_at_once"] else ""
    each = " on each" if plate["support"] == "load_per_particle" else ""
    dashpots = f" ({plate['dashpot_over_load']:.2g} of the load at the drag speed)" if plate["dashpot_over_load"] else ""
    print(
        f"upper plate: {plate['support']}, {plate['patches']} patch(es), {load}{each}{carried}, "
        f"mass {plate['mass']:.3g} kg, damping {plate['damping']:.3g} kg/s{dashpots}, mean gap {pretty(plate['gap'], 'length')}"
    )
    if contact := plate["contact"]:
        scale = contact["approach_scale"]
        thin = f", a^2/R {pretty(scale, 'length')}, debris {contact['height_over_approach']:.2g} of it" if scale else ""
        print_line(
            f"contact of the first bodies: {pretty(contact['load'], 'force')} in all, half width "
            f"{pretty(contact['half_width'], 'length')}, largest pressure {pretty(contact['peak_pressure'], 'pressure')}{thin}"
        )
    if direct := plate["direct_contact"]:
        pressure, length = pretty(direct["pressure_at_zero_gap"], "pressure"), pretty(direct["u0"], "length")
        alone = pretty(direct["gap_without_debris"], "length")
        print_line(
            f"direct contact of the plates: {pressure} exp(-gap / {length}), friction {direct['friction']:g}; alone it would "
            f"carry the load at a gap of {alone}"
        )
    print(f"expected overlap {report['expected_overlap_over_radius']:.2g} of the radius")


def print_rough_plates(report: dict[str, dict[str, Any]]) -> None:
    """Print a paragraph for each rough plate."""
    for side, plate in report.items():
        heights = f"rms height {pretty(plate['rms_height'], 'length')}, rms slope {plate['rms_slope']:.3g}"
        extremes = f"from {pretty(plate['lowest'], 'length')} to {pretty(plate['highest'], 'length')}"
        print_line(f"{side} plate: {heights}, {extremes}, shortest wavelength {pretty(plate['shortest_wavelength'], 'length')}")
        valley, crest = plate["valley_curvature_times_radius"], plate["crest_curvature_times_radius"]
        points = "spheres can touch at several points" if plate["several_contacts"] else "a sphere touches at one point"
        sphere = f"radius of the largest sphere, {pretty(plate['largest_sphere'], 'length')}"
        print_line(f"  curvature times the {sphere}: {valley:.2g} in valleys, {crest:.2g} on crests; {points}")
        if plate["energy_of_merging_contacts_over_load"]:
            length = pretty(plate["energy_of_merging_contacts_over_load"], "length")
            print_line(f"  where two of its contacts become one, energy is made or lost: at most that of the load along {length}")
        if plate["contact_radius"]:
            wide = f"{plate['contact_radius_over_shortest_wavelength']:.2g} of the shortest wavelength"
            print_line(f"  contact radius as on a flat plate {pretty(plate['contact_radius'], 'length')}, {wide}")


def _print_bed(report: Mapping[str, Any]) -> None:
    if scale := report["speed_scale"]:
        wall = f"about {duration(report['estimated_wall_time'])} instead of {duration(scale['requested_wall_time'])}"
        print_line(f"speed: {scale['text']}; {wall}")
    if not (bed := report["bed"]):
        return
    numbers = ""
    if bed["inertial_number"] is not None and bed["softness"] is not None:  # the pressure is known
        numbers = (
            f"inertial number {bed['inertial_number']:.2g} ({bed['inertial_number_largest']:.2g} of the largest body), softness "
            f"{bed['softness']:.2g} (overlaps about {1.0 / bed['softness']:.1g} of the radius); "
        )
    layers = f"{bed['layers']:.1f} layers of {pretty(bed['median_diameter'], 'length')} (median diameter)"
    print_line(f"debris of {layers}, {numbers}{bed['verdict']}")
