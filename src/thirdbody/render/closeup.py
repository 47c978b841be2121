"""Close-up of one particle: its contacts, the force on it at each, and its friction cone.

A cone stands at its contact along the normal and is as high as the load: the arrow of the force then ends inside the cone's base
while the contact sticks, and on its rim where it slips.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pyvista

from thirdbody.palette import INK, SOFT_INK, STATE_COLORS
from thirdbody.render.canvas import Canvas, Overlay
from thirdbody.render.layout import Layout, add_direction, draw_frame, finish_view
from thirdbody.render.picture_data import CloseUpData
from thirdbody.render.viewport import Viewport
from thirdbody.units import with_unit

# Margin around the particle, longest arrow and smallest visible contact, over the particle's size.
_MARGIN, _LONGEST, _SMALLEST = 0.52, 0.62, 0.035
_SLIPPING = 0.999  # a contact slips at this utilisation: the remainder is rounding of the step
_LISTED = 8  # largest number of lines of the list of contacts
_CAMERA = (-0.34, -0.90, 0.30)
# Of the legend: the list names the particle's state.
_ENTRIES = (
    ("spot that sticks", STATE_COLORS["sticking"]),
    ("spot that slips", STATE_COLORS["sliding"]),
    ("force on the particle, inside the cone of friction", INK),
)


def compute_close_up_layout(frames: Iterable[CloseUpData], view: str, fixed: bool) -> Layout:
    """Return the layout for one close-up, or for those of a film, which are processed one at a time."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    full_scale = extent = 0.0
    directions: list[np.ndarray] = []
    for one in frames:
        add_direction(directions, one.picture.drag)
        extent = max(extent, one.extent)
        half, center = _MARGIN * one.extent, fixed * one.center[:2]
        bottom, top = one.center[2] - half, one.center[2] + half
        if one.picture.has_plates:
            bottom, top = one.picture.low[2], _plate_height(one) if one.picture.has_upper else top
        low, high = np.minimum(low, [*(center - half), bottom]), np.maximum(high, [*(center + half), top])
        full_scale = max(full_scale, float(np.linalg.norm(one.spots.force, axis=1).max(initial=0.0)))
    return Layout(view, low, high, np.array(directions).reshape(-1, 2), full_scale, extent=extent, follows=not fixed)


def _plate_height(one: CloseUpData) -> float:
    """Return the height of the plate over this particle: at its own contacts, as each body may carry a separate patch."""
    above = one.spots.position[[partner == "upper plate" for partner in one.spots.against]]
    if len(above):
        return float(one.picture.plate_height_at(above).max())
    return max(one.picture.plate, one.center[2] + 0.5 * one.extent)


def draw_close_up(canvas: Canvas, layout: Layout, one: CloseUpData) -> None:
    """Draw the picture of one particle."""
    size, overlay = canvas.size, Overlay(canvas)
    # keeps a colour scale of numbers
    foot, head = draw_frame(overlay, one.picture, replace(one.picture.legend, entries=_ENTRIES, total=0))
    shift = layout.follows * np.array([*one.center[:2], 0.0])
    wide = size[0] >= 1.25 * size[1]
    area = (0.01, foot, 0.68, head) if wide else (0.01, foot + 0.32 * (head - foot), 0.99, head)
    bounds = (layout.low + shift, layout.high + shift)
    view = Viewport(canvas, one.picture, area, bounds, layout.view, plate_height=_plate_height(one))
    _draw_spots(view, one, layout)
    finish_view(view, overlay, _CAMERA, layout.directions)
    _number_spots(view, overlay, one, layout)
    left, top = (0.69, head) if wide else (0.03, foot + 0.31 * (head - foot))
    _list_spots(overlay, one, left * size[0], top * size[1] - overlay.px(20))


def _color(one: CloseUpData, k: int) -> str:
    return STATE_COLORS["sliding" if one.spots.utilisation[k] >= _SLIPPING else "sticking"]


def _draw_spots(view: Viewport, one: CloseUpData, layout: Layout) -> None:
    spots = one.spots
    # Cones must not reach into the opposite plate.
    longest = min(_LONGEST * layout.extent, 0.8 * float(layout.high[2] - layout.low[2]))
    per_newton = longest * view.scale / max(layout.full_scale, 1e-300)
    smallest = _SMALLEST * layout.extent
    for k in range(len(spots.force)):
        point, normal = view.scaled(spots.position[k]), spots.normal[k]
        height, color = float(spots.force[k] @ normal) * per_newton, _color(one, k)
        radius = max(float(spots.radius[k]), smallest) * view.scale
        disc = pyvista.Cylinder(center=point, direction=normal, radius=radius, height=0.25 * radius, resolution=40)
        view.inner.add(disc, color=color, ambient=0.4)
        if spots.limit[k] > 0.0 and height > 2.0 * radius:
            # The direction of a pyvista cone leads from base to tip, and its centre lies half way.
            axis, base = normal * height, float(spots.limit[k]) * per_newton
            cone = pyvista.Cone(
                center=point + 0.5 * axis, direction=-axis, height=float(np.linalg.norm(axis)), radius=base, capping=False,
                resolution=60,
            )  # fmt: skip
            view.inner.add(cone, color=color, opacity=0.38, ambient=0.5, diffuse=0.5)
            rim = pyvista.Polygon(center=point + axis, radius=base, normal=axis, n_sides=60, fill=False)
            view.inner.add(rim, color=color, lighting=False, line_width=3.5)
        # an arrow of constant shaft; none where it would be a head only
        force, shaft = spots.force[k] * per_newton, 0.28 * smallest * view.scale
        length, head = float(np.linalg.norm(force)), 5.0 * shaft
        if length >= 1.2 * head:
            arrow = pyvista.Arrow(
                start=point, direction=force, tip_length=head / length, tip_radius=2.4 * shaft / length, tip_resolution=30,
                shaft_radius=shaft / length, shaft_resolution=30, scale=length,
            )  # fmt: skip
            view.inner.add(arrow, color=INK, ambient=0.4)


def _number_spots(view: Viewport, overlay: Overlay, one: CloseUpData, layout: Layout) -> None:
    drawn: list[np.ndarray] = []
    apart = 2.1 * _disc_radius(overlay)
    for k, position in enumerate(one.spots.position[:_LISTED]):
        outwards = -one.spots.normal[k] * 0.09 * layout.extent
        point = np.array(view.project(view.scaled(position + outwards)))
        while any(np.hypot(*(point - other)) < apart for other in drawn):
            point = point + [0.5 * apart, 0.0]
        drawn.append(point)
        _draw_number(overlay, one, k, float(point[0]), float(point[1]))


def _disc_radius(overlay: Overlay) -> float:
    return 15.0 / 22.0 * overlay.text_height(22)


def _draw_number(overlay: Overlay, one: CloseUpData, k: int, x: float, y: float) -> None:
    overlay.disc(x, y, _disc_radius(overlay), _color(one, k))
    overlay.text(str(k + 1), x, y, 22, "#FFFFFF", align="center", bold=True)


def _list_spots(overlay: Overlay, one: CloseUpData, x: float, y: float) -> None:
    overlay.text(one.name, x, y - overlay.px(20), 30, bold=True)
    overlay.disc(x + overlay.px(12), y - overlay.px(68), overlay.px(12), one.color)
    overlay.text(one.label or "no label", x + overlay.px(34), y - overlay.px(68), 26)
    y -= overlay.px(126)
    radius = _disc_radius(overlay)
    against, load, used = x + 2.0 * radius + overlay.px(10), x + overlay.px(320), x + overlay.px(476)
    overlay.text("spot against", against, y, 22, SOFT_INK)
    overlay.text("load", load, y, 22, SOFT_INK, align="right")
    overlay.text("friction used", used, y, 22, SOFT_INK, align="right")
    spots, pitch = one.spots, overlay.px(42)
    for k in range(min(len(spots.force), _LISTED)):
        y -= pitch
        _draw_number(overlay, one, k, x + radius, y)
        overlay.text(spots.against[k], against, y, 24)
        overlay.text(with_unit(float(spots.force[k] @ spots.normal[k]), "N"), load, y, 24, align="right")
        overlay.text(f"{100.0 * spots.utilisation[k]:.0f} %", used, y, 24, align="right")
    if len(spots.force) > _LISTED:
        overlay.text(f"and {len(spots.force) - _LISTED} more", against, y - pitch, 22, SOFT_INK)
    elif not len(spots.force):
        overlay.text("no contact carries a load", against, y - pitch, 24, SOFT_INK)
