"""What `thirdbody check` says of rough plates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from thirdbody.system.terminal import print_line
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


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
        if plate["contact_radius"]:
            wide = f"{plate['contact_radius_over_shortest_wavelength']:.2g} of the shortest wavelength"
            print_line(f"  contact radius as on a flat plate {pretty(plate['contact_radius'], 'length')}, {wide}")
