"""Page that shows one frame in a browser, to be turned with the mouse: one HTML file that needs no network.

Spheres are ray-cast impostors by the WebGL program in `web_viewer.html`. The usual export (pyvista with trame) makes glyph
meshes: 12 MB for 12 000 spheres instead of half a megabyte, without a legend, and needs some forty packages and the system
libraries for drawing. Rough plates are grids of heights of two bytes each, from which the page makes meshes.
"""

import base64
import html
import json
import re
from importlib.resources import files
from pathlib import Path

import numpy as np

from thirdbody.atomic_files import write_output
from thirdbody.palette import FIELD_STOPS, rgb
from thirdbody.render.picture_data import PictureData
from thirdbody.render.surfaces import CONTACT, HEIGHTS
from thirdbody.units import with_unit

FINEST = 320  # largest number of points along the longer side of a rough plate: 270 kB of a page for a square plate


def write_page(data: PictureData, path: Path, view: str = "iso") -> Path:
    """Write the page of a frame, seen from `view` first; return its path. Raises OutputError when the file cannot be written."""
    text = files("thirdbody.render").joinpath("web_viewer.html").read_text(encoding="utf-8")
    contents = {
        "@TITLE@": html.escape(data.title or "thirdbody"),
        "@FACTS@": html.escape(data.facts),
        "@LEGEND@": _legend(data),
        # No tag inside a script may end it or begin another.
        "@DATA@": json.dumps(_scene(data) | {"view": view}).replace("<", "\\u003c"),
    }
    text = re.sub("|".join(contents), lambda mark: contents[mark[0]], text)  # once: a title may hold another mark
    write_output(path, text.encode("utf-8"))
    return path


def _scene(data: PictureData) -> dict[str, object]:
    """Return the scene in units of a hundredth of its width, with its middle at the origin; the bodies' names as text."""
    extent = data.high - data.low
    scale = 100.0 / float(max(extent[:2].max(), 1e-300))
    middle = 0.5 * (data.low + data.high)
    spheres = np.column_stack(((data.centers - middle) * scale, data.radii * scale))
    margin = 1.1 * float(data.radii.max(initial=0.0)) * scale
    half, on = 0.5 * extent * scale + [margin, margin, 0.0], data.touching
    return {
        "surfaces": {side: _relief(data, side, middle, half, scale) for side in data.surfaces},
        # place, radius, slopes of the plate: six numbers each
        "contacts": ""
        if on is None
        else _packed(np.column_stack(((on.points - middle) * scale, on.radius * scale, on.slopes)), "<f4"),
        "tones": {"low": rgb(HEIGHTS[0]), "high": rgb(HEIGHTS[1]), "contact": rgb(CONTACT)},
        "spheres": _packed(spheres, "<f4"),
        "colors": _packed(data.colors, "u1"),
        "bodies": _packed(data.body, "<i4"),
        "ids": [int(number) for number in data.ids],
        "labels": list(data.labels),
        "half": [float(value) for value in half],
        "plates": data.has_plates,
        "upper": data.has_upper,
        "drag": [float(value) for value in data.drag],
        "lengths": [{"label": with_unit(m * 10.0**p, "m"), "size": m * 10.0**p * scale} for p in range(-9, 2) for m in (1, 2, 5)],
    }


def _relief(data: PictureData, side: str, middle: np.ndarray, half: np.ndarray, scale: float) -> dict[str, object]:
    """Return a rough plate over the drawn window: heights of a grid in parts of 65535 from `low` to `high`, row by row."""
    surface = data.surfaces[side]
    plane = data.low[2] if side == "lower" else data.plate_height_over(data.low, data.high)
    lengths, cells = 2.0 * half[:2] / scale, surface.coefficients.shape[::-1]
    # a grid as fine as that of the surface shows all of it
    wanted = [length / size * n for length, size, n in zip(lengths, surface.size, cells, strict=True)]
    counts = [max(2, round(n * min(1.0, FINEST / max(wanted)))) for n in wanted]
    x, y = (np.linspace(at - h / scale, at + h / scale, n) for at, h, n in zip(middle, half, counts, strict=False))
    z = (plane - middle[2] + surface.sign * surface.heights(*np.meshgrid(x, y))) * scale
    low, high = float(z.min()), float(z.max())
    grid = np.rint((z - low) * (65535.0 / max(high - low, 1e-300)))
    return {"n": counts, "z": _packed(grid, "<u2"), "low": low, "high": high}


def _packed(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def _legend(data: PictureData) -> str:
    legend, caption = data.legend, f"<small>{html.escape(data.legend.caption)}</small>" if data.legend.caption else ""
    if legend.limits is None:
        entry = '<span class="entry"><i style="background:{}"></i>{}</span>'
        entries = [entry.format(color, html.escape(words)) for words, color in legend.entries]
        return "".join([f"<b>{html.escape(legend.title)}</b>" if legend.title else "", *entries, caption])
    title, ticks = legend.scale()
    marks = "".join(f'<span style="left:{100.0 * left:.2f}%">{number}</span>' for left, number in ticks)
    bar = f'<div class="bar" style="background:linear-gradient(90deg,{",".join(FIELD_STOPS)})"></div>'
    return f'<b>{html.escape(title)}</b><div class="scale">{bar}{marks}</div>{caption}'
