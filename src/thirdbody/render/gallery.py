"""Gallery of bodies as a PNG file: the shapes of a scene's populations, or the fit of spheres to a mesh.

The drawing (`gallery_drawing`) runs in a separate process, as for runs (`render`), which reads the bodies from a file.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.bodies.clump import Clump
from thirdbody.render.render import STILLS, checked_output, draw_elsewhere, usable_windows

BODIES = 12
"""Largest number of bodies drawn of one group."""
GROUPS = 8
"""Largest number of groups: more would make the picture too tall for a graphics card."""


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
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "gallery.npz"
        np.savez(file, title=title, **_packed(groups[:GROUPS]), more=max(0, len(groups) - GROUPS))
        draw_elsewhere({"gallery": str(file), "file": str(png)}, usable_windows())
    return png


def _packed(groups: Sequence[Group]) -> dict[str, Any]:
    """Return the groups as plain arrays, with the drawn bodies only."""
    packed: dict[str, Any] = {"count": len(groups)}
    for g, group in enumerate(groups):
        shown = group.clumps[: 1 if _all_alike(group.clumps) else BODIES]
        packed[f"{g}.words"] = np.array([group.heading, group.facts])
        packed[f"{g}.bodies"] = len(shown)
        if group.vertices is not None and group.faces is not None:
            packed[f"{g}.vertices"], packed[f"{g}.faces"] = group.vertices, group.faces
        for b, body in enumerate(shown):
            packed[f"{g}.{b}"] = np.column_stack((body.centers, body.radii))
            packed[f"{g}.{b}.diameter"] = body.diameter
    return packed


def _all_alike(clumps: Sequence[Clump]) -> bool:
    """Return whether all bodies have one shape, in one size or in several."""
    first = clumps[0]
    return all(
        body is first
        or (len(body.radii) == len(first.radii) and np.allclose(body.centers / body.diameter, first.centers / first.diameter))
        for body in clumps
    )
