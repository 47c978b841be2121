"""One particle close up: its spots, the force on it at each, and the cone in which friction can hold that force.

A cone stands on its spot along the normal and is as high as the load: the arrow of the force then ends inside the cone's
base while the spot sticks, and on its rim where it slips.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thirdbody.output.canvas import PAPER, SOFT_INK, new_window
from thirdbody.output.coloring import Legend
from thirdbody.output.legend import draw_legend, legend_height
from thirdbody.output.overlay import INK, Overlay
from thirdbody.output.palette import STATE_COLORS
from thirdbody.output.picture import HEADING, add_way, finish_view, write_words
from thirdbody.output.quantity import with_unit
from thirdbody.output.spots import CloseUp
from thirdbody.output.view import View

# Room around the particle over its size; longest arrow, and smallest spot that is seen, over its size.
ROOM, LONGEST, SEEN = 0.52, 0.62, 0.035
# A spot whose friction is used up to this share slips: what remains is rounding of the step.
SLIPPING = 0.999
# Lines of the list of spots that fit a picture.
LISTED = 8

CLOSE = (-0.34, -0.90, 0.30)


@dataclass(frozen=True)
class ClosePlan:
    """What stays over a film: size in pixels, view, corners (3,) m of the room relative to the particle or (`fixed`) to
    the domain, directions (k, 2) of the drag, the force (N) of the longest arrow, the particle's size (m)."""

    size: tuple[int, int]
    view: str
    low: np.ndarray
    high: np.ndarray
    fixed: bool
    ways: np.ndarray
    strongest: float
    extent: float


def make_close_plan(shots: Any, size: tuple[int, int], view: str, fixed: bool) -> ClosePlan:
    """The plan for one close-up or for those of a film, which are taken one after the other."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    strongest = extent = 0.0
    ways: list[np.ndarray] = []
    for one in shots:
        add_way(ways, one.shot.drag)
        place = one.center if fixed else np.zeros(3)
        extent = max(extent, one.extent)
        half = ROOM * one.extent
        floor, top = (one.shot.low[2], _ceiling(one)) if one.shot.has_plates else (one.center[2] - half, one.center[2] + half)
        low = np.minimum(low, [*(place[:2] - half), floor])
        high = np.maximum(high, [*(place[:2] + half), top])
        strongest = max(strongest, float(np.linalg.norm(one.spots.force, axis=1).max(initial=0.0)))
    return ClosePlan(size, view, low, high, fixed, np.array(ways).reshape(-1, 2), strongest, extent)


def _ceiling(one: CloseUp) -> float:
    """Where the plate is over this particle: at its own spots, for each may carry a patch of its own."""
    above = [place[2] for place, against in zip(one.spots.place, one.spots.against, strict=True) if against == "upper plate"]
    return max(above) if above else max(one.shot.plate, one.center[2] + 0.5 * one.extent)


def compose_close_up(one: CloseUp, plan: ClosePlan, used: Any = None) -> Any:
    """A window (the used one, if given) with the picture of one particle in it, not yet drawn."""
    size = plan.size
    window = new_window(size, used)
    overlay = Overlay(window, size)
    legend = _legend(one)
    foot, head = legend_height(overlay, legend, size) / size[1], 1.0 - overlay.px(HEADING) / size[1]
    shift = np.zeros(3) if plan.fixed else np.array([*one.center[:2], 0.0])
    wide = size[0] >= 1.25 * size[1]
    place = (0.01, foot, 0.68, head) if wide else (0.01, foot + 0.32 * (head - foot), 0.99, head)
    view = View(window, one.shot, place, plan.low + shift, plan.high + shift, PAPER, plan.view, roof=_ceiling(one))
    draw_spots(view, one, plan)
    view.make_room(plan.ways)
    finish_view(view, overlay, CLOSE, view.add_arrow())
    _number_spots(view, overlay, one, plan)
    left, top = (0.69, head) if wide else (0.03, foot + 0.31 * (head - foot))
    _list_spots(overlay, one, left * size[0], top * size[1] - overlay.px(20))
    write_words(overlay, one.shot.title, one.shot.facts, size)
    draw_legend(overlay, legend, size)
    return window


def _legend(one: CloseUp) -> Legend:
    entries = (
        ("spot that sticks", STATE_COLORS["sticking"]),
        ("spot that slips", STATE_COLORS["sliding"]),
        ("force on the particle, inside the cone of friction", INK),
    )
    # The list names the particle's state; a colour scale of numbers is needed.
    return replace(one.shot.legend, entries=entries, total=0)


def _tone(utilisation: float) -> str:
    return STATE_COLORS["sliding" if utilisation >= SLIPPING else "sticking"]


def draw_spots(view: View, one: CloseUp, plan: ClosePlan) -> None:
    """Discs, cones and arrows, seen through the particle."""
    import vtk

    spots = one.spots
    # Cones shall not stand in the plate opposite.
    room = min(LONGEST * plan.extent, 0.8 * float(plan.high[2] - plan.low[2]))
    long = room * view.scale / max(plan.strongest, 1e-300)
    for k in range(len(spots.force)):
        place, normal = view.scaled(spots.place[k]), spots.normal[k]
        load = float(spots.force[k] @ normal)
        tone = _tone(float(spots.utilisation[k]))
        radius = max(float(spots.radius[k]), SEEN * plan.extent) * view.scale
        disc = vtk.vtkCylinderSource()
        disc.SetResolution(40)
        disc.SetRadius(radius)
        disc.SetHeight(0.25 * radius)
        _stand(view, disc, place, normal, tone)
        if spots.limit[k] > 0.0 and load * long > 2.0 * radius:
            _cone(view, place, normal, load * long, float(spots.limit[k]) * long, tone)
        _arrow(view, place, spots.force[k] * long, 0.28 * SEEN * plan.extent * view.scale)


def _cone(view: View, place: np.ndarray, normal: np.ndarray, height: float, radius: float, tone: str) -> None:
    """A translucent cone with its point at a place, and the rim of its base."""
    import vtk

    cone = vtk.vtkConeSource()
    cone.SetResolution(60)
    cone.SetHeight(height)
    cone.SetRadius(radius)
    cone.CappingOff()
    # VTK's cone points along its direction, from the base to the point, and is centred half way.
    cone.SetDirection(*(-normal))
    cone.SetCenter(*(place + 0.5 * height * normal))
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(cone.GetOutputPort())
    look = view.add(mapper, tone, 0.38, seen_through=True).GetProperty()
    look.SetAmbient(0.5)
    look.SetDiffuse(0.5)
    rim = vtk.vtkRegularPolygonSource()
    rim.SetNumberOfSides(60)
    rim.SetRadius(radius)
    rim.GeneratePolygonOff()
    rim.SetNormal(*normal)
    rim.SetCenter(*(place + height * normal))
    lines = vtk.vtkPolyDataMapper()
    lines.SetInputConnection(rim.GetOutputPort())
    look = view.add(lines, tone, seen_through=True).GetProperty()
    look.SetLighting(False)
    look.SetLineWidth(3.5)


def _stand(view: View, source: Any, place: np.ndarray, normal: np.ndarray, tone: str) -> None:
    """A solid of revolution about y, turned to stand along a normal at a place."""
    import vtk

    turn = vtk.vtkTransform()
    turn.Translate(*place)
    axis = np.cross([0.0, 1.0, 0.0], normal)
    angle = np.degrees(np.arctan2(np.linalg.norm(axis), normal[1]))
    turn.RotateWXYZ(float(angle), *(axis if np.linalg.norm(axis) > 1e-9 else [1.0, 0.0, 0.0]))
    moved = vtk.vtkTransformPolyDataFilter()
    moved.SetInputConnection(source.GetOutputPort())
    moved.SetTransform(turn)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(moved.GetOutputPort())
    look = view.add(mapper, tone, seen_through=True).GetProperty()
    look.SetAmbient(0.4)


def _arrow(view: View, place: np.ndarray, way: np.ndarray, shaft: float) -> None:
    """An arrow along `way` whose shaft has this radius whatever its length."""
    import vtk

    length = float(np.linalg.norm(way))
    head = 5.0 * shaft
    if length < 1.2 * head:
        return
    direction = way / length
    rod = vtk.vtkCylinderSource()
    rod.SetResolution(30)
    rod.SetRadius(shaft)
    rod.SetHeight(length - head)
    _stand(view, rod, place + 0.5 * (length - head) * direction, direction, INK)
    point = vtk.vtkConeSource()
    point.SetResolution(30)
    point.SetRadius(2.4 * shaft)
    point.SetHeight(head)
    point.SetDirection(*direction)
    point.SetCenter(*(place + (length - 0.5 * head) * direction))
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(point.GetOutputPort())
    view.add(mapper, INK, seen_through=True)


def _number_spots(view: View, overlay: Overlay, one: CloseUp, plan: ClosePlan) -> None:
    """A number beside each spot, away from the particle so that it covers nothing of it, and none over another."""
    taken: list[np.ndarray] = []
    apart = 2.1 * overlay.px(15)
    for k, place in enumerate(one.spots.place[:LISTED]):
        away = -one.spots.normal[k] * 0.09 * plan.extent
        at = np.array(view.on_picture(view.scaled(place + away)))
        while any(np.hypot(*(at - other)) < apart for other in taken):
            at = at + [0.5 * apart, 0.0]
        taken.append(at)
        overlay.disc(at[0], at[1], overlay.px(15), _tone(float(one.spots.utilisation[k])))
        overlay.text(str(k + 1), at[0], at[1], 22, "#FFFFFF", align="center", bold=True)


def _list_spots(overlay: Overlay, one: CloseUp, x: float, y: float) -> None:
    """What the particle does, and a line for each spot."""
    overlay.text(one.name, x, y - overlay.px(20), 30, bold=True)
    overlay.disc(x + overlay.px(12), y - overlay.px(68), overlay.px(12), one.color)
    overlay.text(one.label or "no label", x + overlay.px(34), y - overlay.px(68), 26)
    y -= overlay.px(126)
    against, load, used = x + overlay.px(40), x + overlay.px(320), x + overlay.px(476)
    overlay.text("spot against", against, y, 22, SOFT_INK)
    overlay.text("load", load, y, 22, SOFT_INK, align="right")
    overlay.text("friction used", used, y, 22, SOFT_INK, align="right")
    spots = one.spots
    for k in range(min(len(spots.force), LISTED)):
        y -= overlay.px(42)
        overlay.disc(x + overlay.px(15), y, overlay.px(14), _tone(float(spots.utilisation[k])))
        overlay.text(str(k + 1), x + overlay.px(15), y, 20, "#FFFFFF", align="center", bold=True)
        overlay.text(spots.against[k], against, y, 24)
        overlay.text(with_unit(float(spots.force[k] @ spots.normal[k]), "N"), load, y, 24, align="right")
        overlay.text(f"{100.0 * spots.utilisation[k]:.0f} %", used, y, 24, align="right")
    y -= overlay.px(42)
    if len(spots.force) > LISTED:
        overlay.text(f"and {len(spots.force) - LISTED} more", against, y, 22, SOFT_INK)
    elif not len(spots.force):
        overlay.text("no contact carries a load", against, y, 24, SOFT_INK)
