"""What `thirdbody check` says of the plates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from thirdbody.kernels.tables import patch
from thirdbody.system.terminal import print_line
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.engine.upper_plate import UpperPlate


def plate_report(built: Simulation) -> dict[str, Any] | None:
    """Return the figures of the upper plate; None without one."""
    upper = built.state.world.upper
    if upper is None:
        return None
    return {
        "patches": len(upper.heights),
        "load": float(upper.load.max()) if upper.foundation is None else upper.foundation.load,
        "support": built.scene.plates.upper.support if built.scene.plates.upper else "none",
        "free": upper.free if upper.foundation is None else upper.foundation.free,
        "mass": float(upper.mass.mean()),
        "damping": float(upper.damping.mean()),
        "gap": float(upper.heights.mean()),
        "moves": upper.schedule.moves,
        "largest_load": upper.schedule.largest_load() * float(upper.table()[:, patch.NOMINAL_LOAD].max()),
        "loaded_at_once": built.upper.loaded,
        "foundation": None if upper.foundation is None else upper.foundation.stiffness,
        "preload": 0.0 if upper.foundation is None else float(upper.load.max()),
        "direct_contact": _direct_report(built, upper),
    }


def _direct_report(built: Simulation, upper: UpperPlate) -> dict[str, Any] | None:
    """Return the direct contact of the plates, and the gap at which it alone carries the load; None without."""
    if upper.direct is None:
        return None
    direct, area = upper.direct, built.scene.domain.size[0] * built.scene.domain.size[1]
    load = float(upper.load.max()) if upper.foundation is None else upper.foundation.load
    return {
        "pressure_at_zero_gap": direct.prefactor / area, "u0": direct.length, "friction": direct.friction,
        "gap_without_debris": direct.gap(load),
    }  # fmt: skip


def print_plate(report: dict[str, Any]) -> None:
    """Print support, load and gap of the upper plate."""
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
    print(
        f"upper plate: {plate['support']}, {plate['patches']} patch(es), {load}{each}{carried}, "
        f"mass {plate['mass']:.3g} kg, damping {plate['damping']:.3g} kg/s, mean gap {pretty(plate['gap'], 'length')}"
    )
    if direct := plate["direct_contact"]:
        pressure, length = pretty(direct["pressure_at_zero_gap"], "pressure"), pretty(direct["u0"], "length")
        alone = pretty(direct["gap_without_debris"], "length")
        print_line(
            f"direct contact of the plates: {pressure} exp(-gap / {length}), friction {direct['friction']:g}; alone it would "
            f"carry the load at a gap of {alone}"
        )
    print(f"expected overlap {report['expected_overlap_over_radius']:.2g} of the radius")


def rough_plates(built: Simulation) -> dict[str, dict[str, Any]]:
    """Return the figures of rough plates by side; none of flat ones."""
    return {side: scales.document() for side, scales in built.surface_scales.items()}


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
