"""View of a part of the domain: spheres, plates, force tubes, the drag arrow, a scale bar, and its camera."""

from typing import Any

import numpy as np
import pyvista

from thirdbody.palette import FORCE_COLORS, INK, mixed, pale
from thirdbody.render.canvas import OVERSAMPLING, WIDTH, Canvas, Rectangle
from thirdbody.render.picture_data import PictureData
from thirdbody.render.surfaces import CONTACT, skirt, window_mesh
from thirdbody.units import round_length, with_unit

_PLATE, _PLATE_EDGES = "#DDE1E6", "#8A929C"
_GLASS, _GLASS_EDGES = "#9DB9DD", "#4F74A8"
_ROUGH_GLASS = 0.35  # opacity of an upper plate that is rough: its heights must be seen, and the bodies below it
_SHADOW = "#A9B0BA"
ARROW = "#B0303C"

# Direction to the camera; `iso` is in perspective, the others in parallel projection, so that lengths hold everywhere.
_DIRECTIONS = {"side": (0.0, -1.0, 0.0), "front": (1.0, 0.0, 0.0), "top": (0.0, 0.0, 1.0)}
_ALONG = 0.9  # cosine above which an arrow points along the line of sight
# Fraction of white in bodies through which tubes are seen: for states, and for numbers, which must stay readable.
_PALE, _PALE_NUMBERS = 0.45, 0.2
# Radius of the thickest tube over the mean radius of the bodies, of the thinnest that is drawn over it, and the number of sides.
_THICKEST, _THINNEST, _SIDES = 0.17, 0.05, 8
SMALLEST_DRAWN = 0.7  # mean diameter of the spheres in pixels below which their mean colours are drawn instead
_ANGLE = 24.0  # vertical angle of view [degrees]


class Viewport:
    """View of a window of the domain, in a part of the picture (fractions of its size).

    `low`, `high` (3,) bound the visible volume [m]; in a film they stay while plates move. `plate_height` [m] is where the upper
    plate is drawn, over all bodies in the window if not given.
    """

    def __init__(
        self, canvas: Canvas, data: PictureData, viewport: Rectangle, bounds: tuple[np.ndarray, np.ndarray], view: str,
        plate_height: float | None = None,
    ):  # fmt: skip
        low, high = bounds
        self._data, self._view, self._window = data, view, bounds
        self._outer, self.inner = canvas.add_view(viewport)
        self.project = self._outer.project
        self._pixels = canvas.size[0] * (viewport[2] - viewport[0]), canvas.size[1] * (viewport[3] - viewport[1])
        # VTK's own tolerances suit lengths around one, not micrometres.
        self.scale = 100.0 / float(np.max(high[:2] - low[:2]))
        self._origin = np.array([*(0.5 * (low[:2] + high[:2])), low[2]])
        # Room for the halves of bodies whose centres lie in the window.
        margin = 1.1 * float(data.radii.max(initial=0.0)) * np.array([1.0, 1.0, 0.0])
        self._low, self._high = self.scaled(low - margin), self.scaled(high + margin)
        # Thin relative to the gap, but always thick enough to be visible.
        thickness = min(max(0.4 * float(self._high[2] - self._low[2]), 1.5), 5.0)
        self._thickness = thickness if data.has_plates else 0.0
        # From the side the plates are thin relative to the arrow of the other views.
        self._arrow_length = 9.0 if view in ("side", "front") else 17.0
        # Line width scales with the height of text.
        self._line_unit = OVERSAMPLING * max(min(canvas.size[0] / WIDTH, canvas.size[1] / 900.0), 0.6)
        height = data.plate_height_over(low, high) if plate_height is None else plate_height
        self._ceiling = float(self.scaled(np.array([0.0, 0.0, height]))[2])
        self._bottom = float(self._low[2]) - self._thickness
        self._corners = [self._low - [0, 0, self._thickness], self._high + [0, 0, self._thickness]]
        self._add_spheres(data.inside(low, high))
        if data.has_plates:
            self._add_plates()

    def scaled(self, points: np.ndarray) -> np.ndarray:
        """Return points (..., 3) [m] in the units of the view."""
        return (points - self._origin) * self.scale

    def _add_spheres(self, chosen: np.ndarray) -> None:
        data = self._data
        white = _PALE if data.legend.limits is None else _PALE_NUMBERS
        colors = data.colors if data.tubes is None else pale(data.colors, white)
        centers, radii = self.scaled(data.centers[chosen]), data.radii[chosen] * self.scale
        extent = (self._high - self._low)[:2]
        cells = np.maximum(1, np.rint(extent * float(np.min(self._pixels / extent)))).astype(np.int64)  # one per pixel, about
        if len(centers) and 2.0 * float(np.mean(radii)) < SMALLEST_DRAWN * float(np.max(extent / cells)):
            self._add_map(centers, colors[chosen], cells)
            return
        if data.has_plates and len(centers) and "lower" not in data.surfaces:
            # discs on the lower plate: without them the height of a body is not visible
            floor = float(self.scaled(data.low)[2]) + 0.03
            points = pyvista.PolyData(np.column_stack((centers[:, :2], np.full(len(centers), floor))).astype(np.float32))
            points["radius"] = np.float32(radii)
            disc = pyvista.Polygon(radius=1.0, n_sides=20)
            shadows = points.glyph(orient=False, scale="radius", geom=disc)
            self._outer.add(shadows, color=_SHADOW, scalars=None, lighting=False)
        self._outer.add_spheres(centers, radii, colors[chosen])

    def _add_map(self, centers: np.ndarray, colors: np.ndarray, cells: np.ndarray) -> None:
        """Draw the mean colour of the spheres in each cell on a plane through their middle: single ones would be lost."""
        low, high = self._low[:2], self._high[:2]
        column, row = np.clip((centers[:, :2] - low) / (high - low) * cells, 0, cells - 1).astype(np.int64).T
        at, total = row * cells[0] + column, int(np.prod(cells))
        count = np.bincount(at, minlength=total)
        sums = np.column_stack([np.bincount(at, colors[:, k], total) for k in range(3)])
        drawn = count > 0
        x, y = (np.linspace(low[k], high[k], cells[k] + 1) for k in range(2))
        z = float(np.mean(centers[:, 2]))
        grid: Any = pyvista.StructuredGrid(*np.meshgrid(x, y, [z], indexing="ij"))
        part = grid.extract_cells(drawn)
        part.cell_data["color"] = np.rint(sums[drawn] / count[drawn, None]).astype(np.uint8)
        self._outer.add(part, scalars="color", rgb=True, lighting=False)

    def _add_plates(self) -> None:
        floor = float(self.scaled(self._data.low)[2])
        if "lower" in self._data.surfaces:
            self._add_surface("lower", floor)
            self._add_contacts(*self._window)
        else:
            self._add_box(floor - self._thickness, _PLATE, _PLATE_EDGES, 1.0)
        if "upper" in self._data.surfaces:
            self._add_surface("upper", self._ceiling)
        elif self._data.has_upper:
            self._add_box(self._ceiling, _GLASS, _GLASS_EDGES, 0.13)

    def _add_surface(self, side: str, plane: float) -> None:
        """Draw a rough plate: its heights about a plane, and walls at the edge of the window; the upper one like glass."""
        data, surface = self._data, self._data.surfaces[side]
        low, high = (corner / self.scale + self._origin for corner in (self._low, self._high))
        chosen = data.inside(*self._window) & (side == "lower")
        mesh = window_mesh(surface, low, high, data.centers[chosen], data.radii[chosen])
        mesh.points = self.scaled(np.asarray(mesh.points) - [0.0, 0.0, surface.position[2] - self._origin[2]]) + [0.0, 0.0, plane]
        reach = max(abs(surface.low), abs(surface.high)) * self.scale + 0.5 * self._thickness
        back = plane - surface.sign * reach
        walls = skirt(mesh, back)
        self._corners += [np.array([x, y, back]) for x in (self._low[0], self._high[0]) for y in (self._low[1], self._high[1])]
        self._bottom = min(self._bottom, back)
        flat = pyvista.PolyData(mesh.points, faces=mesh.cast_to_unstructured_grid().cells)
        smooth = flat.compute_normals(cell_normals=False)
        smooth["color"] = mesh["color"]
        glass, color = (1.0, _PLATE) if side == "lower" else (_ROUGH_GLASS, _GLASS)
        self._outer.add(smooth, scalars="color", rgb=True, opacity=glass, ambient=0.5, diffuse=0.55)
        self._outer.add(walls, color=color, opacity=glass, ambient=0.55, diffuse=0.45)
        if side == "upper":
            for rim in np.split(np.asarray(walls.points), 2):  # of the surface, and of its back
                self._add_line(np.vstack([rim, rim[:1]]), 1.4, _GLASS_EDGES)

    def _add_contacts(self, low: np.ndarray, high: np.ndarray) -> None:
        """Draw the contacts with the rough lower plate, of bodies in a window, as discs along its surface."""
        touching = self._data.touching
        chosen = np.zeros(0, bool) if touching is None else self._data.bodies_inside(low, high)[touching.body]
        if touching is None or not chosen.any():
            return
        cloud = pyvista.PolyData(self.scaled(touching.points[chosen]).astype(np.float32))
        cloud["radius"] = (touching.radius[chosen] * self.scale).astype(np.float32)
        cloud["normal"] = np.insert(-touching.slopes[chosen], 2, 1.0, axis=1).astype(np.float32)
        disc = pyvista.Cylinder(direction=(1.0, 0.0, 0.0), radius=1.0, height=0.3, resolution=20)
        self._outer.add(cloud.glyph(orient="normal", scale="radius", geom=disc), color=CONTACT, scalars=None, lighting=False)

    def _add_box(self, bottom: float, color: str, edges: str, opacity: float) -> None:
        (x0, y0), (x1, y1) = self._low[:2], self._high[:2]
        box = pyvista.Cube(bounds=(x0, x1, y0, y1, bottom, bottom + self._thickness), clean=False)
        self._outer.add(box, color=color, opacity=opacity, ambient=0.55, diffuse=0.45)
        self._outer.add(box.outline(), color=edges, lighting=False, line_width=1.4 * self._line_unit)

    def add_tubes(self, full_scale: float) -> None:
        """Draw the contact forces of the bodies in the window; `full_scale` [N] is that of the thickest tube."""
        tubes, (low, high) = self._data.tubes, self._window
        if tubes is None or full_scale <= 0.0:
            return
        # Bodies are about as large as twice their spheres.
        thickest = _THICKEST * 2.0 * float(np.mean(self._data.radii)) * self.scale
        radii = thickest * np.minimum(tubes.force / full_scale, 1.0)
        visible = self._data.bodies_inside(low, high)[tubes.body] & (radii > _THINNEST * thickest)
        if not visible.any():
            return
        ends = np.stack([self.scaled(tubes.start[visible]), self.scaled(tubes.end[visible])], axis=1)
        points: Any = ends.reshape(-1, 3).astype(np.float32)
        mesh = pyvista.line_segments_from_points(points)
        mesh["radius"] = np.repeat(np.float32(radii[visible]), 2)
        colors = mixed(FORCE_COLORS, tubes.force / full_scale) if tubes.colors is None else tubes.colors
        mesh["color"] = np.repeat(colors[visible], 2, axis=0)
        tube = mesh.tube(scalars="radius", absolute=True, n_sides=_SIDES)
        self.inner.add(tube, scalars="color", rgb=True, ambient=0.35, diffuse=0.75)

    def _arrow_ends(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        half, middle = 0.5 * (self._high - self._low), 0.5 * (self._high + self._low)
        reach = min(h / abs(d) for h, d in zip(half[:2], direction, strict=True) if abs(d) > 1e-9)
        start = np.array([*(middle[:2] + direction * (reach + 2.0)), self._high[2] + 0.5 * self._thickness])
        return start, start + np.array([*(direction * self._arrow_length), 0.0])

    def _towards_viewer(self, direction: np.ndarray) -> float:
        """Return the cosine of the angle between a direction and that to the camera, for views without perspective."""
        return float(direction @ np.array(_DIRECTIONS[self._view][:2])) if self._view in _DIRECTIONS else 0.0

    def fit_arrows(self, directions: np.ndarray) -> None:
        """Extend the visible volume by arrows in all these directions (k, 2)."""
        for direction in directions:
            tip = self._arrow_ends(direction)[1]
            if abs(self._towards_viewer(direction)) < _ALONG:
                self._corners += [tip + 2.0, tip - 2.0]

    def add_arrow(self) -> tuple[np.ndarray, str] | None:
        """Draw an arrow at the leading edge of the upper plate along its motion; return the position and text of its label.

        Along the line of sight an arrow is a disc: there is only the label.
        """
        drag = self._data.drag
        if not drag.any():
            return None
        towards = self._towards_viewer(drag)
        if abs(towards) >= _ALONG:
            middle = 0.5 * (self._low + self._high) * [1, 1, 0] + [0, 0, self._high[2] + self._thickness]
            return middle, f"drag {'towards' if towards > 0.0 else 'away from'} the viewer"
        start, tip = self._arrow_ends(drag)
        length = self._arrow_length
        arrow = pyvista.Arrow(
            start=start, direction=[*drag, 0.0], tip_length=0.42, tip_radius=0.15, tip_resolution=40, shaft_radius=0.055,
            shaft_resolution=40, scale=length,
        )  # fmt: skip
        self._outer.add(arrow, color=ARROW, ambient=0.4)
        above = np.array([0.0, 1.0, 0.0] if self._view == "top" else [0.0, 0.0, 1.0])
        return tip - 0.2 * length * np.array([*drag, 0.0]) + 0.15 * length * above, "drag"

    def add_outline(self, low: np.ndarray, high: np.ndarray) -> None:
        """Draw the outline of another window, on the upper plate."""
        (a, b, _), (c, d, _) = (self.scaled(np.array([*corner[:2], 0.0])) for corner in (low, high))
        corners = np.array([(a, b), (c, b), (c, d), (a, d), (a, b)])
        self._add_line(np.insert(corners, 2, self._ceiling + self._thickness, axis=1), 2.6)

    def add_contact(self) -> None:
        """Draw the outline of the contact of the first bodies, on the lower plate, as far as it is in the window."""
        if self._data.outline is None:
            return
        points = self.scaled(np.insert(self._data.outline, 2, 0.0, axis=1))
        points[:, :2] = np.clip(points[:, :2], self._low[:2], self._high[:2])
        points[:, 2] = float(self.scaled(self._data.low)[2]) + 0.06
        self._add_line(points, 3.2, ARROW)

    def _add_line(self, points: np.ndarray, width: float, color: str = INK) -> None:
        self._outer.add(pyvista.MultipleLines(points), color=color, lighting=False, line_width=width * self._line_unit)

    def add_scale_bar(self) -> tuple[np.ndarray, str]:
        """Draw a bar of a round length before the lower plate, or below it; return the position and text of its label.

        It lies in the scene because in a perspective view a length holds at one depth only.
        """
        along, across = {"side": (0, 2), "front": (1, 2)}.get(self._view, (0, 1))
        length = round_length(0.28 * float(self._high[along] - self._low[along]) / self.scale)
        flat = across == 2
        start = np.array([*self._low[:2], self._bottom])
        start[across] -= 2.5 if flat else 4.5
        start[along] += 2.0
        step, side = np.eye(3)[along], np.eye(3)[across]
        end = start + step * length * self.scale
        self._add_line(np.array([start, end]), 4.0)
        for point in (start, end):
            tick = (0.8 if flat else 1.5) * side
            self._add_line(np.array([point - tick, point + tick]), 3.0)
        middle = 0.5 * (start + end) - (1.0 if flat else 2.2) * side
        self._corners += [middle - 3.5 * side, end]
        return middle, with_unit(length, "m")

    def aim_camera(self, iso: tuple[float, float, float]) -> None:
        """Turn the camera so that everything just fits; it looks from `iso` in the view of that name."""
        perspective = self._view not in _DIRECTIONS
        low, high = self._corners[:2]
        box = [np.array([x, y, z]) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        points = np.array(box + self._corners[2:])
        back = np.array(iso if perspective else _DIRECTIONS[self._view])
        back /= np.linalg.norm(back)
        upright = (0.0, 1.0, 0.0) if abs(back[2]) > 0.999 else (0.0, 0.0, 1.0)
        right = np.cross(upright, back)
        right /= np.linalg.norm(right)
        axes = np.array([right, np.cross(back, right), back])
        focus, distance, extent = (_fit_perspective if perspective else _fit_parallel)(points, axes, self._pixels)
        camera = self._outer.renderer.camera
        camera.view_angle = _ANGLE
        camera.parallel_projection = not perspective
        camera.parallel_scale = extent
        camera.focal_point, camera.position, camera.up = focus, focus + distance * back, upright
        self._outer.renderer.reset_camera_clipping_range()
        near, far = camera.clipping_range
        camera.clipping_range = 0.9 * near, 1.1 * far  # objects seen through bodies need a wider range


Pose = tuple[np.ndarray, float, float]


def _fit_parallel(points: np.ndarray, axes: np.ndarray, pixels: tuple[float, float]) -> Pose:
    # Focus, distance and half height of a picture of that size in which all points just fit, without perspective; `axes` (3, 3)
    # are the camera's right, up and back.
    flat = points @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    half = 0.5 * (high - low)
    return 0.5 * (low + high) @ axes, 300.0 + half[2], float(max(half[1], half[0] / (pixels[0] / pixels[1]))) / 0.97


def _fit_perspective(points: np.ndarray, axes: np.ndarray, pixels: tuple[float, float]) -> Pose:
    # The same in perspective; the half height is unused. A fixed-point iteration: shift the focus to the middle of the
    # projection, then set the distance; converges in a few steps.
    reach = np.tan(np.radians(0.5 * _ANGLE)) * np.array([pixels[0] / pixels[1], 1.0])
    focus, distance = points.mean(axis=0), 300.0
    for _ in range(30):
        offset = (points - focus) @ axes.T
        flat = offset[:, :2] / (distance - offset[:, 2:]) / reach
        middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
        focus = focus + distance * (middle * reach) @ axes[:2]
        distance *= float((0.5 * np.ptp(flat, axis=0)).max()) / 0.97
    return focus, distance, 1.0
