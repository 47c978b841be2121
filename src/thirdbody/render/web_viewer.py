"""Page that shows one frame in a browser, to be turned with the mouse: one HTML file that needs no network.

Spheres are ray-cast impostors by the WebGL program in `web_viewer.html`. The usual export (pyvista with trame) makes glyph
meshes: 12 MB for 12 000 spheres instead of half a megabyte, without a legend, and needs some forty packages and the system
libraries for drawing.
"""

import base64
import html
import json
from importlib.resources import files
from pathlib import Path

import numpy as np

from thirdbody.atomic_files import write_whole
from thirdbody.palette import FIELD_STOPS
from thirdbody.quantity import prefix_for, ticks, with_unit
from thirdbody.render.picture_data import PictureData


def write_page(data: PictureData, path: Path, view: str = "iso") -> Path:
    """Write the page of a frame, seen from `view` first; return its path. Raises OSError when the file cannot be written."""
    text = files("thirdbody.render").joinpath("web_viewer.html").read_text(encoding="utf-8")
    for mark, content in {
        "@TITLE@": html.escape(data.title or "thirdbody"),
        "@FACTS@": html.escape(data.facts + ("   ·   this page draws rough plates flat" if data.surfaces else "")),
        "@LEGEND@": _legend(data),
        # No tag inside a script may end it or begin another.
        "@DATA@": json.dumps(_scene(data) | {"view": view}).replace("<", "\\u003c"),
    }.items():
        text = text.replace(mark, content)
    write_whole(path, text.encode("utf-8"))
    return path


def _scene(data: PictureData) -> dict[str, object]:
    """Return the scene in units of a hundredth of its width, with its middle at the origin; the bodies' names as text."""
    extent = data.high - data.low
    scale = 100.0 / float(max(extent[:2].max(), 1e-300))
    middle = 0.5 * (data.low + data.high)
    spheres = np.column_stack(((data.centers - middle) * scale, data.radii * scale))
    margin = 1.1 * float(data.radii.max(initial=0.0)) * scale
    half = 0.5 * extent * scale + [margin, margin, 0.0]
    return {
        "spheres": _packed(spheres, "<f4"),
        "colors": _packed(data.colors, "u1"),
        "bodies": _packed(data.body, "<i4"),
        "ids": [int(number) for number in data.ids],
        "labels": list(data.labels),
        "half": [float(value) for value in half],
        "plates": data.has_plates,
        "drag": [float(value) for value in data.drag],
        "lengths": [{"label": with_unit(m * 10.0**p, "m"), "size": m * 10.0**p * scale} for p in range(-9, 2) for m in (1, 2, 5)],
    }


def _packed(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def _legend(data: PictureData) -> str:
    legend = data.legend
    if legend.limits is None:
        entry = '<span class="entry"><i style="background:{}"></i>{}</span>'
        entries = [entry.format(color, html.escape(words)) for words, color in legend.entries]
        return "".join([f"<b>{html.escape(legend.title)}</b>" if legend.title else "", *entries])
    low, high = legend.limits
    factor, unit = prefix_for(max(abs(low), abs(high)), legend.unit)
    values = np.array(ticks(low * factor, high * factor))
    percent = 100.0 * (values / factor - low) / (high - low) if high > low else [50.0]
    marks = "".join(f'<span style="left:{left:.2f}%">{value:.6g}</span>' for left, value in zip(percent, values, strict=True))
    title = html.escape(legend.title + (f", {unit}" if unit else ""))
    bar = f'<div class="bar" style="background:linear-gradient(90deg,{",".join(FIELD_STOPS)})"></div>'
    return f'<b>{title}</b><div class="scale">{bar}{marks}</div>'
