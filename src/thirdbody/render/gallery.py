"""Gallery of bodies as a PNG file: the shapes of a scene's populations, or the fit of spheres to a mesh.

A second process (`elsewhere`) draws the bodies in parallel projection, so that one scale bar holds for all bodies of
a group. The unit of length is the pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.bodies.clump import Clump
from thirdbody.palette import INK, SOFT_INK, field_colors
from thirdbody.render.elsewhere import draw_elsewhere
from thirdbody.render.render import STILLS, checked_output
from thirdbody.units import round_length, with_unit

BODIES = 12  # largest number of bodies drawn of one group
GROUPS = 8  # largest number of groups: more would make the picture too tall for a graphics card

# Pixels.
_WIDTH, _MARGIN, _TITLE, _HEADING, _LABEL, _GAP, _LEGEND = 1600, 40, 84, 92, 36, 34, 72
_COLUMNS, _TALLEST = 6, 400
# Fraction of its cell that the largest body fills.
_FILL = 0.9
_STEEL = "#9FB4CC"
# Principal axes on the screen (rows: right, up, towards the viewer): the long axis mostly to the right, the short one
# mostly to the viewer, turned by 30 degrees about the upright and 25 about the level axis so that all three show.
_UPRIGHT, _LEVEL = np.radians(30.0), np.radians(25.0)


@dataclass(frozen=True, eq=False)
class Group:
    """Bodies drawn at one scale under a heading; for a mesh, its vertices (v, 3) [m] in the clump's frame and faces (f, 3)."""

    heading: str
    facts: str
    clumps: Sequence[Clump]
    vertices: np.ndarray | None = None
    faces: np.ndarray | None = None


def draw_gallery(groups: Sequence[Group], title: str, png: str | Path) -> Path:
    """Draw up to 12 bodies of each of up to 8 groups into a PNG file; return its path.

    Colours show the radius of each sphere over the equivalent radius of its body. A mesh is drawn alone, as spheres, and
    translucent over them. Raises InputError for another suffix, OutputError when the file cannot be written, MissingLibrary when
    the system cannot draw.
    """
    png = checked_output(png, STILLS)
    shown = [replace(group, clumps=_different(group.clumps)) for group in groups[:GROUPS]]
    draw_elsewhere(__name__, {"groups": shown, "title": title, "more": max(0, len(groups) - GROUPS), "file": str(png)})
    return png


def _different(clumps: Sequence[Clump]) -> Sequence[Clump]:
    """Return the bodies to draw: one if all have its shape."""
    first = clumps[0]
    alike = all(
        body is first
        or (len(body.radii) == len(first.radii) and np.allclose(body.centers / body.diameter, first.centers / first.diameter))
        for body in clumps
    )
    return clumps[: 1 if alike else BODIES]


class _Block:
    """Layout of one group: its cells (body, whether spheres and mesh are drawn, text below), their size and scale [pixels].

    `top` is set when the picture's height is known.
    """

    def __init__(self, group: Group):
        self.group, self.vertices = group, None if group.vertices is None else on_screen(group.vertices)
        self.cells: list[tuple[Clump, bool, bool, str]] = []
        if self.vertices is None:
            for body in group.clumps:
                count = len(body.radii)
                self.cells.append((body, True, False, f"{with_unit(body.diameter, 'm')}, {count} sphere{'s' * (count > 1)}"))
        else:
            words = "mesh", "mesh over spheres", f"{len(group.clumps[0].radii)} spheres"
            self.cells = [(group.clumps[0], k > 0, k < 2, text) for k, text in enumerate(words)]
        self.columns = min(_COLUMNS, len(self.cells))
        rows = -(-len(self.cells) // self.columns)
        self.wide = (_WIDTH - 2 * _MARGIN) / self.columns
        span = np.max([high - low for low, high in (self.box(body) for body, _, _, _ in self.cells)], axis=0)
        tallest = min(self.wide, _TALLEST if len(self.cells) > 1 else 0.6 * _TALLEST)
        self.scale = _FILL * float(min(self.wide / span[0], tallest / span[1]))
        self.tall = float(span[1]) * self.scale + 0.1 * tallest
        self.height, self.top = _HEADING + rows * (self.tall + _LABEL) + _GAP, 0.0

    def box(self, body: Clump) -> tuple[np.ndarray, np.ndarray]:
        """Return the corners (2,) of a body on the screen [m]; the same for all views of a mesh."""
        flat, radii = on_screen(body.centers)[:, :2], body.radii[:, None]
        points = [flat - radii, flat + radii, *([] if self.vertices is None else [self.vertices[:, :2]])]
        return np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)

    def middle(self, number: int) -> tuple[float, float]:
        """Return the centre of a cell [pixels]."""
        row, column = divmod(number, self.columns)
        return _MARGIN + (column + 0.5) * self.wide, self.top - _HEADING - row * (self.tall + _LABEL) - 0.5 * self.tall


def on_screen(points: np.ndarray) -> np.ndarray:
    """Return points (n, 3) of a clump's frame as right, up, towards the viewer."""
    cu, su, cl, sl = np.cos(_UPRIGHT), np.sin(_UPRIGHT), np.cos(_LEVEL), np.sin(_LEVEL)
    upright = np.array([[cu, 0.0, su], [0.0, 1.0, 0.0], [-su, 0.0, cu]])
    level = np.array([[1.0, 0.0, 0.0], [0.0, cl, -sl], [0.0, sl, cl]])
    return points @ (level @ upright).T


def draw(job: dict[str, Any]) -> None:
    """Draw the bodies of a job of `draw_gallery`, in the second process. Raises OutputError."""
    from thirdbody.render.canvas import Canvas, Overlay, save_png
    from thirdbody.render.coloring import Legend
    from thirdbody.render.layout import draw_legend

    blocks = [_Block(group) for group in job["groups"]]
    height = int(_TITLE + sum(block.height for block in blocks) + _LEGEND)
    ratios = np.concatenate([2.0 * body.radii / body.diameter for block in blocks for body in block.group.clumps])
    low, high = float(ratios.min()), float(ratios.max())
    limits = (low, high) if high - low > 1e-3 * high else (0.0, high)  # apart even if all are equal
    with Canvas((_WIDTH, height), views=1) as canvas:
        pane, overlay = canvas.add_view((0.0, 0.0, 1.0, 1.0))[0], Overlay(canvas, reference=height)
        pane.show_pixels()
        top = float(height - _TITLE)
        for block in blocks:
            block.top = top
            _draw_block(pane, overlay, block, limits)
            top -= block.height
        overlay.text(job["title"], _MARGIN, height - 44, 34, bold=True)
        if job["more"]:
            overlay.text(f"{job['more']} more not drawn", _WIDTH - _MARGIN, height - 44, 24, align="right")
        draw_legend(overlay, Legend("radius of a sphere over the equivalent radius of its body", limits=limits))
        save_png(canvas.pixels(), Path(job["file"]))


def _draw_block(pane: Any, overlay: Any, block: _Block, limits: tuple[float, float]) -> None:
    import pyvista

    from thirdbody.render.canvas import GLOSSY, rectangle

    overlay.text(block.group.heading, _MARGIN, block.top - 22, 28, bold=True)
    overlay.text(block.group.facts, _MARGIN, block.top - 58, 22, SOFT_INK)
    # scale bar at the right of the heading
    length = round_length(180.0 / block.scale)
    right, y, wide = _WIDTH - _MARGIN, block.top - 52, length * block.scale
    for x0, x1, half in ((right - wide, right, 2.5), (right - wide, right - wide + 3, 9.0), (right - 3, right, 9.0)):
        overlay.polygon(rectangle(x0, y - half, x1, y + half), INK)
    overlay.text(with_unit(length, "m"), right - 0.5 * wide, y + 28, 22, align="center")
    for number, (body, has_spheres, has_mesh, words) in enumerate(block.cells):
        x, y = block.middle(number)
        low, high = block.box(body)
        shift = np.array([x, y, 0.0]) - np.array([*(0.5 * (low + high)), 0.0]) * block.scale
        if has_spheres:
            colors = field_colors((2.0 * body.radii / body.diameter - limits[0]) / (limits[1] - limits[0]))
            pane.add_spheres(on_screen(body.centers) * block.scale + shift, body.radii * block.scale, colors)
        if has_mesh and block.vertices is not None and block.group.faces is not None:
            mesh = pyvista.PolyData.from_regular_faces(block.vertices * block.scale + shift, block.group.faces)
            smooth = mesh.compute_normals(feature_angle=30.0, split_vertices=True, cell_normals=False)
            pane.add(smooth, color=_STEEL, opacity=0.45 if has_spheres else 1.0, culling="back", **GLOSSY)
        overlay.text(words, x, y - 0.5 * block.tall - 0.45 * _LABEL, 20, SOFT_INK, align="center")
