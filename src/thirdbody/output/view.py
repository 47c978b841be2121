"""One view of a part of the domain: spheres, plates, tubes, the arrow of the drag and a scale bar, and its camera.

Spheres are ray-cast impostors (one point each, no triangles).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from thirdbody.output.canvas import add_lights, make_glossy, sphere_mapper
from thirdbody.output.forces import THICKEST, tube_mapper
from thirdbody.output.overlay import INK, INNER_LAYER, OVERSAMPLING, WIDTH, unit_rgb
from thirdbody.output.palette import pale
from thirdbody.output.quantity import round_length, with_unit
from thirdbody.output.shot import Shot

PLATE = "#DDE1E6"
SHADOW = "#A9B0BA"
GLASS = "#9DB9DD"
ARROW = "#B0303C"

# From where the camera looks; `iso` is seen in perspective, the others are not, so that lengths hold everywhere.
DIRECTIONS = {"side": (0.0, -1.0, 0.0), "front": (1.0, 0.0, 0.0), "top": (0.0, 0.0, 1.0)}

# Cosine from which on an arrow points along the line of sight.
ALONG = 0.9

# Share of white in the colours of bodies through which tubes are seen: of states, and of numbers, which must stay readable.
PALE, PALE_NUMBERS = 0.45, 0.2

Rectangle = tuple[float, float, float, float]


class View:
    """One view of a window of the domain, in a part of the picture (fractions of its size).

    `low`, `high` (3,) bound what the camera keeps in sight, in m; in a film they stay while plates move. `roof` (m)
    is where the upper plate is drawn, over all bodies in the window if not given.
    """

    def __init__(
        self,
        window: Any,
        shot: Shot,
        place: Rectangle,
        low: np.ndarray,
        high: np.ndarray,
        paper: str,
        view: str = "iso",
        roof: float | None = None,
    ):
        import vtk

        self._vtk, self._shot, self._place, self._view = vtk, shot, place, view
        # VTK's own tolerances suit lengths around one, not micrometres.
        self.scale = 100.0 / float(np.max(high[:2] - low[:2]))
        self._origin = np.array([*(0.5 * (low[:2] + high[:2])), low[2]])
        # Room for the halves of bodies whose centres lie in the window.
        margin = 1.1 * float(shot.radii.max(initial=0.0)) * np.array([1.0, 1.0, 0.0])
        self._low, self._high = self.scaled(low - margin), self.scaled(high + margin)
        # Thin beside what lies between them, but never thinner than can be seen.
        thick = min(max(0.4 * float(self._high[2] - self._low[2]), 1.5), 5.0)
        self._thick = thick if shot.has_plates else 0.0
        self._renderer = vtk.vtkRenderer()
        self._renderer.SetViewport(*place)
        self._renderer.SetBackground(*unit_rgb(paper))
        window.AddRenderer(self._renderer)
        self._window = window
        self._inner: Any = None
        wide, tall = window.GetSize()
        # Lines are as thick as words are high.
        self._pixel = OVERSAMPLING * max(min(wide / WIDTH, tall / 900.0) / OVERSAMPLING, 0.6)
        add_lights(self._renderer)
        self._chosen = (low, high)
        roof = shot.ceiling(low, high) if roof is None else roof
        self._ceiling = float(self.scaled(np.array([0.0, 0.0, roof]))[2])
        self._add_spheres(shot.inside(low, high))
        self._corners = [self._low - [0, 0, self._thick], self._high + [0, 0, self._thick]]
        self.arrow_end: np.ndarray | None = None
        if shot.has_plates:
            self._add_plates()

    def scaled(self, point: np.ndarray) -> np.ndarray:
        """Places (..., 3) m in the units of the view."""
        return (point - self._origin) * self.scale

    def _add_spheres(self, chosen: np.ndarray) -> None:
        shot = self._shot
        share = PALE if shot.legend.limits is None else PALE_NUMBERS
        colors = shot.colors if shot.tubes is None else pale(shot.colors, share)
        mapper, data = sphere_mapper(self.scaled(shot.centers[chosen]), shot.radii[chosen] * self.scale, colors[chosen])
        if shot.has_plates:
            self._add_shadows(data)
        make_glossy(self.add(mapper))

    def _add_shadows(self, spheres: Any) -> None:
        """A disc on the lower plate under each sphere: without it nobody can tell how high a body is."""
        vtk = self._vtk
        disc = vtk.vtkRegularPolygonSource()
        disc.SetNumberOfSides(20)
        disc.SetRadius(1.0)
        disc.GeneratePolylineOff()
        flat = vtk.vtkTransform()
        flat.Translate(0.0, 0.0, float(self.scaled(self._shot.low)[2]) + 0.03)
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
        self.add(mapper, SHADOW).GetProperty().SetLighting(False)

    def add(self, mapper: Any, color: str | None = None, opacity: float = 1.0, seen_through: bool = False) -> Any:
        """Put a mapper into the view, or (`seen_through`) over all bodies and plates; returns its actor."""
        actor = self._vtk.vtkActor()
        actor.SetMapper(mapper)
        if color:
            actor.GetProperty().SetColor(*unit_rgb(color))
        actor.GetProperty().SetOpacity(opacity)
        (self._inner_renderer() if seen_through else self._renderer).AddActor(actor)
        return actor

    def _inner_renderer(self) -> Any:
        """What lies inside of bodies, seen through them by the same camera."""
        if self._inner is None:
            self._inner = self._vtk.vtkRenderer()
            self._inner.SetLayer(INNER_LAYER)
            self._inner.SetViewport(*self._place)
            self._inner.SetActiveCamera(self._renderer.GetActiveCamera())
            add_lights(self._inner)
            self._window.AddRenderer(self._inner)
        return self._inner

    def _add_box(self, low: np.ndarray, high: np.ndarray, color: str, opacity: float, edges: str) -> None:
        vtk = self._vtk
        source = vtk.vtkCubeSource()
        source.SetBounds(low[0], high[0], low[1], high[1], low[2], high[2])
        mapper = vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(source.GetOutputPort())
        look = self.add(mapper, color, opacity).GetProperty()
        look.SetAmbient(0.55)
        look.SetDiffuse(0.45)
        outline = vtk.vtkOutlineFilter()
        outline.SetInputConnection(source.GetOutputPort())
        lines = vtk.vtkPolyDataMapper()
        lines.SetInputConnection(outline.GetOutputPort())
        look = self.add(lines, edges).GetProperty()
        look.SetLighting(False)
        look.SetLineWidth(1.4 * self._pixel)

    def _add_plates(self) -> None:
        floor, ceiling = self.scaled(self._shot.low)[2], self._ceiling
        (x0, y0), (x1, y1) = self._low[:2], self._high[:2]
        self._add_box(np.array([x0, y0, floor - self._thick]), np.array([x1, y1, floor]), PLATE, 1.0, "#8A929C")
        self._add_box(np.array([x0, y0, ceiling]), np.array([x1, y1, ceiling + self._thick]), GLASS, 0.13, "#4F74A8")

    def add_tubes(self, strongest: float) -> None:
        """The contact forces of the bodies in the window; `strongest` (N) is that of the thickest tube."""
        tubes, (low, high) = self._shot.tubes, self._chosen
        if tubes is None or strongest <= 0.0:
            return
        bodies = self._shot.bodies
        inside = np.all((bodies[:, :2] >= low[:2]) & (bodies[:, :2] <= high[:2]), axis=1)[tubes.body]
        # Bodies are about as large as twice their spheres.
        thickest = THICKEST * 2.0 * float(np.mean(self._shot.radii)) * self.scale
        radii = thickest * np.minimum(tubes.force / strongest, 1.0)
        seen = inside & (radii > 0.02 * thickest)
        mapper = tube_mapper(self.scaled(tubes.start[seen]), self.scaled(tubes.end[seen]), radii[seen], tubes.colors[seen])
        look = self.add(mapper, seen_through=True).GetProperty()
        look.SetAmbient(0.35)
        look.SetDiffuse(0.75)

    def _arrow_ends(self, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Start and tip of an arrow at the leading edge of the upper plate, in a direction (2,)."""
        half, middle = 0.5 * (self._high - self._low), 0.5 * (self._high + self._low)
        reach = min(h / abs(d) for h, d in zip(half[:2], way, strict=True) if abs(d) > 1e-9)
        start = np.array([*(middle[:2] + way * (reach + 2.0)), self._high[2] + 0.5 * self._thick])
        return start, start + np.array([*(way * self._arrow_length), 0.0])

    @property
    def _arrow_length(self) -> float:
        # From the side the plates are thin beside the arrow of the other views.
        return 9.0 if self._view in ("side", "front") else 17.0

    def _along_sight(self, way: np.ndarray) -> float:
        """Cosine of the angle between a direction and that to the camera, of views without perspective."""
        return float(way @ np.array(DIRECTIONS[self._view][:2])) if self._view in DIRECTIONS else 0.0

    def make_room(self, ways: np.ndarray) -> None:
        """Let the camera keep arrows in all these directions (k, 2) in sight."""
        for way in ways:
            tip = self._arrow_ends(way)[1]
            if abs(self._along_sight(way)) < ALONG:
                self._corners += [tip + 2.0, tip - 2.0]

    def add_arrow(self) -> str:
        """An arrow at the leading edge of the upper plate, in the direction of its motion; returns the words for it.

        Along the line of sight an arrow is a disc: there are only the words.
        """
        drag = self._shot.drag
        if not drag.any():
            return ""
        start, tip = self._arrow_ends(drag)
        towards = self._along_sight(drag)
        if abs(towards) >= ALONG:
            self.arrow_end = 0.5 * (self._low + self._high) * [1, 1, 0] + [0, 0, self._high[2] + self._thick]
            return "drag towards the viewer" if towards > 0.0 else "drag away from the viewer"
        self.arrow_end = tip + np.array([*(-0.2 * self._arrow_length * drag), 0.15 * self._arrow_length])
        if self._view == "top":
            self.arrow_end = tip + np.array([*(-0.2 * self._arrow_length * drag), 0.0]) + [0.0, 0.15 * self._arrow_length, 0.0]
        self._draw_arrow(start, drag)
        return "drag"

    def _draw_arrow(self, start: np.ndarray, drag: np.ndarray) -> None:
        source = self._vtk.vtkArrowSource()
        source.SetTipResolution(40)
        source.SetShaftResolution(40)
        source.SetShaftRadius(0.055)
        source.SetTipRadius(0.15)
        source.SetTipLength(0.42)
        turn = self._vtk.vtkTransform()
        turn.Translate(*start)
        turn.RotateZ(float(np.degrees(np.arctan2(drag[1], drag[0]))))
        turn.Scale(*3 * [self._arrow_length])
        moved = self._vtk.vtkTransformPolyDataFilter()
        moved.SetInputConnection(source.GetOutputPort())
        moved.SetTransform(turn)
        mapper = self._vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(moved.GetOutputPort())
        self.add(mapper, ARROW).GetProperty().SetAmbient(0.4)

    def add_frame(self, low: np.ndarray, high: np.ndarray) -> None:
        """The outline of another window, on the upper plate."""
        a, b = self.scaled(np.array([*low[:2], 0.0])), self.scaled(np.array([*high[:2], 0.0]))
        z = self._ceiling + self._thick
        self._add_line([(a[0], a[1], z), (b[0], a[1], z), (b[0], b[1], z), (a[0], b[1], z), (a[0], a[1], z)], INK, 2.6)

    def _add_line(self, places: list[tuple[float, float, float]], color: str, width: float) -> None:
        source = self._vtk.vtkLineSource()
        points = self._vtk.vtkPoints()
        for place in places:
            points.InsertNextPoint(*place)
        source.SetPoints(points)
        mapper = self._vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(source.GetOutputPort())
        look = self.add(mapper, color).GetProperty()
        look.SetLighting(False)
        look.SetLineWidth(width * self._pixel)

    def add_scale_bar(self) -> tuple[np.ndarray, str]:
        """A bar of a round length before the lower plate, or below it; returns the place of its label and the words.

        It lies in the scene because in a perspective view a length holds at one depth only.
        """
        along, away = {"side": (0, 2), "front": (1, 2)}.get(self._view, (0, 1))
        length = round_length(0.28 * float(self._high[along] - self._low[along]) / self.scale)
        corner = self._low - [0.0, 0.0, self._thick]
        corner[away] -= 2.5 if away == 2 else 4.5
        corner[along] += 2.0
        step, side = np.eye(3)[along], np.eye(3)[away]
        end = corner + step * length * self.scale
        self._add_line([tuple(corner), tuple(end)], INK, 4.0)
        for place in (corner, end):
            tick = (0.8 if away == 2 else 1.5) * side
            self._add_line([tuple(place - tick), tuple(place + tick)], INK, 3.0)
        middle = 0.5 * (corner + end) - (1.0 if away == 2 else 2.2) * side
        self._corners += [middle - 3.5 * side, end]
        return middle, with_unit(length, "m")

    def aim(self, iso: tuple[float, float, float]) -> None:
        """Turn the camera so that everything just fits; it looks from `iso` in the view of that name."""
        direction, perspective = DIRECTIONS.get(self._view, iso), self._view not in DIRECTIONS
        low, high = self._corners[0], self._corners[1]
        box = [np.array([x, y, z]) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        points = np.array(box + self._corners[2:])
        camera = self._renderer.GetActiveCamera()
        back = np.array(direction) / np.linalg.norm(direction)
        upright = [0.0, 1.0, 0.0] if abs(back[2]) > 0.999 else [0.0, 0.0, 1.0]
        right = np.cross(upright, back)
        right /= np.linalg.norm(right)
        up = np.cross(back, right)
        width, height = self._window.GetSize()
        x0, y0, x1, y1 = self._place
        aspect = width * (x1 - x0) / (height * (y1 - y0))
        place = _perspective if perspective else _parallel
        focus, distance, extent = place(points, back, right, up, aspect)
        camera.SetViewAngle(ANGLE)
        camera.SetParallelProjection(not perspective)
        camera.SetParallelScale(extent)
        camera.SetFocalPoint(*focus)
        camera.SetPosition(*(focus + distance * back))
        camera.SetViewUp(*upright)
        self._renderer.ResetCameraClippingRange()
        near, far = camera.GetClippingRange()
        camera.SetClippingRange(0.9 * near, 1.1 * far)  # room for what is seen through bodies

    def on_picture(self, place: np.ndarray) -> tuple[float, float]:
        """Where a place of the scene appears, in pixels of the picture."""
        self._renderer.SetWorldPoint(*place, 1.0)
        self._renderer.WorldToDisplay()
        x, y, _ = self._renderer.GetDisplayPoint()
        return x / OVERSAMPLING, y / OVERSAMPLING


ANGLE = 24.0
"""Of view, upright, degrees."""

Pose = tuple[np.ndarray, float, float]


def _parallel(points: np.ndarray, back: np.ndarray, right: np.ndarray, up: np.ndarray, aspect: float) -> Pose:
    """Focus, distance and half height of the picture in which all points just fit, without perspective."""
    flat = np.stack([points @ right, points @ up, points @ back], axis=1)
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    focus = middle[0] * right + middle[1] * up + middle[2] * back
    return focus, 300.0 + half[2], float(max(half[1], half[0] / aspect)) / 0.97


def _perspective(points: np.ndarray, back: np.ndarray, right: np.ndarray, up: np.ndarray, aspect: float) -> Pose:
    """The same in perspective; the half height is unused.

    A fixed point: shift the focus to the middle of the projection, then set the distance; settles in a few.
    """
    reach = np.tan(np.radians(0.5 * ANGLE)) * np.array([aspect, 1.0])
    focus, distance = points.mean(axis=0), 300.0
    for _ in range(30):
        depth = distance - (points - focus) @ back
        flat = np.stack([(points - focus) @ right, (points - focus) @ up], axis=1) / depth[:, None] / reach
        middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
        focus = focus + distance * (middle[0] * reach[0] * right + middle[1] * reach[1] * up)
        distance *= float((0.5 * np.ptp(flat, axis=0)).max()) / 0.97
    return focus, distance, 1.0
