"""Draws a shot with VTK, without a screen. Runs in a process of its own (`render`): VTK may crash where it
cannot draw.

Spheres are ray-cast impostors (one point each, no triangles); everything is drawn at twice the size and
averaged.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.output.canvas import PAPER, SOFT_INK, add_lights, make_glossy, new_window, save, sphere_mapper
from thirdbody.output.overlay import INK, OVERSAMPLING, Overlay, unit_rgb
from thirdbody.output.palette import field_colors
from thirdbody.output.shot import Legend, Shot, close_up_window, round_length, with_unit

PLATE = "#DDE1E6"
SHADOW = "#A9B0BA"
GLASS = "#9DB9DD"
PANEL = "#F5F7F9"
ARROW = "#B0303C"

Rectangle = tuple[float, float, float, float]


class View:
    """One perspective view of a window of the domain, in a part of the picture (fractions of its size)."""

    def __init__(
        self, window: Any, shot: Shot, place: Rectangle, low: np.ndarray, high: np.ndarray, paper: str
    ):
        import vtk

        self._vtk, self._shot, self._place = vtk, shot, place
        # VTK's own tolerances suit lengths around one, not micrometres.
        self._scale = 100.0 / float(np.max(high[:2] - low[:2]))
        self._origin = np.array([*(0.5 * (low[:2] + high[:2])), shot.low[2]])
        # Room for the halves of bodies whose centres lie in the window.
        margin = 1.1 * float(shot.radii.max(initial=0.0))
        self._low = self._scaled(np.array([*(low[:2] - margin), shot.low[2]]))
        self._high = self._scaled(np.array([*(high[:2] + margin), shot.high[2]]))
        # Thin beside what lies between them, but never thinner than can be seen.
        self._thick = max(0.4 * float(self._high[2] - self._low[2]), 1.5)
        self._renderer = vtk.vtkRenderer()
        self._renderer.SetViewport(*place)
        self._renderer.SetBackground(*unit_rgb(paper))
        window.AddRenderer(self._renderer)
        self._window = window
        add_lights(self._renderer)
        self._add_spheres(shot.inside(low, high))
        self._corners = [self._low - [0, 0, self._thick], self._high + [0, 0, self._thick]]
        if shot.has_plates:
            self._add_plates()

    def _scaled(self, point: np.ndarray) -> np.ndarray:
        return (point - self._origin) * self._scale

    def _add_spheres(self, chosen: np.ndarray) -> None:
        shot = self._shot
        mapper, data = sphere_mapper(self._scaled(shot.centers[chosen]), shot.radii[chosen] * self._scale, shot.colors[chosen])
        if shot.has_plates:
            self._add_shadows(data)
        make_glossy(self._add(mapper))

    def _add_shadows(self, spheres: Any) -> None:
        """A disc on the lower plate under each sphere: without it nobody can tell how high a body is."""
        vtk = self._vtk
        disc = vtk.vtkRegularPolygonSource()
        disc.SetNumberOfSides(20)
        disc.SetRadius(1.0)
        disc.GeneratePolylineOff()
        flat = vtk.vtkTransform()
        flat.Translate(0.0, 0.0, float(self._low[2]) + 0.03)
        flat.Scale(1.0, 1.0, 0.0)
        spheres.GetPointData().SetActiveScalars("radius")
        glyphs = vtk.vtkGlyph3D()
        glyphs.SetInputData(spheres)
        glyphs.SetSourceConnection(disc.GetOutputPort())
        glyphs.SetScaleModeToScaleByScalar()
        moved = vtk.vtkTransformPolyDataFilter()
        moved.SetInputConnection(glyphs.GetOutputPort())
        moved.SetTransform(flat)
        mapper = vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(moved.GetOutputPort())
        mapper.ScalarVisibilityOff()
        self._add(mapper, SHADOW).GetProperty().SetLighting(False)

    def _add(self, mapper: Any, color: str | None = None, opacity: float = 1.0) -> Any:
        actor = self._vtk.vtkActor()
        actor.SetMapper(mapper)
        if color:
            actor.GetProperty().SetColor(*unit_rgb(color))
        actor.GetProperty().SetOpacity(opacity)
        self._renderer.AddActor(actor)
        return actor

    def _add_box(self, low: np.ndarray, high: np.ndarray, color: str, opacity: float, edges: str) -> None:
        vtk = self._vtk
        source = vtk.vtkCubeSource()
        source.SetBounds(low[0], high[0], low[1], high[1], low[2], high[2])
        mapper = vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(source.GetOutputPort())
        look = self._add(mapper, color, opacity).GetProperty()
        look.SetAmbient(0.55)
        look.SetDiffuse(0.45)
        outline = vtk.vtkOutlineFilter()
        outline.SetInputConnection(source.GetOutputPort())
        lines = vtk.vtkPolyDataMapper()
        lines.SetInputConnection(outline.GetOutputPort())
        look = self._add(lines, edges).GetProperty()
        look.SetLighting(False)
        look.SetLineWidth(1.4 * OVERSAMPLING)

    def _add_plates(self) -> None:
        below, above = np.array([0, 0, self._thick]), np.array([0, 0, self._thick])
        bottom = np.array([*self._high[:2], self._low[2]])
        top = np.array([*self._low[:2], self._high[2]])
        self._add_box(self._low - below, bottom, PLATE, 1.0, "#8A929C")
        self._add_box(top, self._high + above, GLASS, 0.13, "#4F74A8")

    def add_arrow(self) -> None:
        """An arrow at the leading edge of the upper plate, in the direction of its motion."""
        drag = self._shot.drag
        if not drag.any():
            return
        half = 0.5 * (self._high - self._low)
        middle = 0.5 * (self._high + self._low)
        reach = min(h / abs(d) for h, d in zip(half[:2], drag, strict=True) if abs(d) > 1e-9)
        start = np.array([*(middle[:2] + drag * (reach + 2.0)), self._high[2] + 0.5 * self._thick])
        length = 17.0
        source = self._vtk.vtkArrowSource()
        source.SetTipResolution(40)
        source.SetShaftResolution(40)
        source.SetShaftRadius(0.055)
        source.SetTipRadius(0.15)
        source.SetTipLength(0.42)
        turn = self._vtk.vtkTransform()
        turn.Translate(*start)
        turn.RotateZ(float(np.degrees(np.arctan2(drag[1], drag[0]))))
        turn.Scale(length, length, length)
        moved = self._vtk.vtkTransformPolyDataFilter()
        moved.SetInputConnection(source.GetOutputPort())
        moved.SetTransform(turn)
        mapper = self._vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(moved.GetOutputPort())
        self._add(mapper, ARROW).GetProperty().SetAmbient(0.4)
        tip = start + np.array([*(drag * length), 0.0])
        self._corners += [tip + 2.0, tip - 2.0]
        self._arrow_end = tip

    def add_frame(self, low: np.ndarray, high: np.ndarray) -> None:
        """The outline of another window, on the upper plate."""
        a = self._scaled(np.array([*low, self._shot.high[2]]))
        b = self._scaled(np.array([*high, self._shot.high[2]]))
        z = self._high[2] + (self._thick if self._shot.has_plates else 0.0)
        corners = [(a[0], a[1], z), (b[0], a[1], z), (b[0], b[1], z), (a[0], b[1], z), (a[0], a[1], z)]
        self._add_line(corners, INK, 2.6)

    def _add_line(self, places: list[tuple[float, float, float]], color: str, width: float) -> None:
        source = self._vtk.vtkLineSource()
        points = self._vtk.vtkPoints()
        for place in places:
            points.InsertNextPoint(*place)
        source.SetPoints(points)
        mapper = self._vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(source.GetOutputPort())
        look = self._add(mapper, color).GetProperty()
        look.SetLighting(False)
        look.SetLineWidth(width * OVERSAMPLING)

    def add_scale_bar(self) -> tuple[np.ndarray, str]:
        """A bar of a round length along x before the lower plate; returns the place of its label and the
        words.

        It lies in the scene because in a perspective view a length holds at one depth only.
        """
        length = round_length(0.28 * float(self._high[0] - self._low[0]) / self._scale)
        z = float(self._low[2] - (self._thick if self._shot.has_plates else 0.0))
        y = float(self._low[1]) - 4.5
        left = float(self._low[0]) + 2.0
        right = left + length * self._scale
        self._add_line([(left, y, z), (right, y, z)], INK, 4.0)
        for x in (left, right):
            self._add_line([(x, y - 1.5, z), (x, y + 1.5, z)], INK, 3.0)
        middle = np.array([0.5 * (left + right), y - 2.2, z])
        self._corners += [middle - [0, 3.5, 0], np.array([right, y, z])]
        return middle, with_unit(length, "m")

    def aim(self, direction: tuple[float, float, float]) -> None:
        """Turn the camera so that it looks from `direction` and everything just fits."""
        low, high = self._corners[0], self._corners[1]
        box = [
            np.array([x, y, z])
            for x in (low[0], high[0])
            for y in (low[1], high[1])
            for z in (low[2], high[2])
        ]
        points = np.array(box + self._corners[2:])
        camera = self._renderer.GetActiveCamera()
        angle = 24.0
        camera.SetViewAngle(angle)
        back = np.array(direction) / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        up = np.cross(back, right)
        width, height = self._window.GetSize()
        x0, y0, x1, y1 = self._place
        aspect = width * (x1 - x0) / (height * (y1 - y0))
        reach = np.tan(np.radians(0.5 * angle)) * np.array([aspect, 1.0])
        focus, distance = points.mean(axis=0), 300.0
        # A fixed point: shift the focus to the middle of the projection, then set the distance; settles in a
        # few.
        for _ in range(30):
            depth = distance - (points - focus) @ back
            flat = (
                np.stack([(points - focus) @ right, (points - focus) @ up], axis=1) / depth[:, None] / reach
            )
            middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
            focus = focus + distance * (middle[0] * reach[0] * right + middle[1] * reach[1] * up)
            distance *= float((0.5 * np.ptp(flat, axis=0)).max()) / 0.97
        camera.SetFocalPoint(*focus)
        camera.SetPosition(*(focus + distance * back))
        camera.SetViewUp(0.0, 0.0, 1.0)
        self._renderer.ResetCameraClippingRange()

    def on_picture(self, place: np.ndarray) -> tuple[float, float]:
        """Where a place of the scene appears, in pixels of the picture."""
        self._renderer.SetWorldPoint(*place, 1.0)
        self._renderer.WorldToDisplay()
        x, y, _ = self._renderer.GetDisplayPoint()
        return x / OVERSAMPLING, y / OVERSAMPLING

    @property
    def arrow_end(self) -> np.ndarray | None:
        return getattr(self, "_arrow_end", None)


def draw(shot: Shot, path: Path, size: tuple[int, int], zoom: float | None) -> None:
    """Draw a shot into a PNG file of `size` pixels.

    Without `zoom` the whole is shown, and of many bodies a part beside it enlarged; `zoom` is the share of
    the domain's width and depth that is shown alone. Raises OSError when the file cannot be written.
    """
    window = new_window(size)
    overlay = Overlay(window, size)
    part = close_up_window(shot) if zoom is None else None
    low, high = shot.low[:2], shot.high[:2]
    if zoom is not None:
        middle, half = 0.5 * (low + high), 0.5 * zoom * (high - low)
        low, high = middle - half, middle + half
    place = (0.01, 0.11, 0.56 if part else 0.99, 0.86)
    whole = View(window, shot, place, low, high, PAPER)
    if part:
        whole.add_frame(*part)
    whole.add_arrow()
    _finish_view(whole, overlay, (-0.42, -0.80, 0.80) if part else (-0.42, -0.85, 0.5))
    if part:
        _draw_close_up(window, shot, overlay, part, size)
    _write_words(overlay, shot, size)
    draw_legend(overlay, shot.legend, size)
    save(window, path, size)


def _finish_view(view: View, overlay: Overlay, direction: tuple[float, float, float]) -> None:
    place, words = view.add_scale_bar()
    view.aim(direction)
    x, y = view.on_picture(place)
    overlay.text(words, x - overlay.px(4), y - overlay.px(22), 24, align="center")
    if view.arrow_end is not None:
        x, y = view.on_picture(view.arrow_end)
        overlay.text("drag", x - overlay.px(16), y + overlay.px(34), 24, ARROW, align="center", bold=True)


def _draw_close_up(
    window: Any, shot: Shot, overlay: Overlay, part: tuple[np.ndarray, np.ndarray], size: tuple[int, int]
) -> None:
    place = (0.565, 0.115, 0.985, 0.865)
    view = View(window, shot, place, *part, PANEL)
    _finish_view(view, overlay, (-0.40, -0.85, 0.60))
    x0, y0, x1, y1 = (value * size[i % 2] for i, value in enumerate(place))
    overlay.polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), SOFT_INK, outline=True)
    overlay.text("close-up", x0 + overlay.px(16), y1 - overlay.px(24), 24, SOFT_INK)


def _write_words(overlay: Overlay, shot: Shot, size: tuple[int, int]) -> None:
    left = overlay.px(32)
    if shot.title:
        overlay.text(shot.title, left, size[1] - overlay.px(40), 36, bold=True)
    overlay.text(shot.facts, left, size[1] - overlay.px(88), 26, SOFT_INK)


def draw_legend(overlay: Overlay, legend: Legend, size: tuple[int, int]) -> None:
    """The states and their colours, or a colour scale, along the lower edge."""
    y = overlay.px(48)
    if legend.limits is None:
        x = overlay.px(44)
        for words, color in legend.entries:
            overlay.disc(x, y, overlay.px(13), color)
            x += overlay.px(24) + overlay.text(words, x + overlay.px(24), y, 28) + overlay.px(58)
        return
    low, high = (f"{value:.3g}" for value in legend.limits)
    x, wide, tall = overlay.px(44), 0.32 * size[0], overlay.px(14)
    x += overlay.text(legend.title, x, y, 28) + overlay.px(36)
    x += overlay.text(low, x, y, 26) + overlay.px(16)
    edges = np.linspace(x, x + wide, 129)
    for i, color in enumerate(field_colors((np.arange(128) + 0.5) / 128)):
        a, b = edges[i], edges[i + 1]
        strip = np.array([[a, y - tall], [b, y - tall], [b, y + tall], [a, y + tall]])
        overlay.polygon(strip, f"#{bytes(color).hex()}")
    overlay.text(high, x + wide + overlay.px(16), y, 26)
