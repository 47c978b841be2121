"""Page that shows a run in a browser, to be turned and played: one HTML file that needs no network.

Spheres are ray-cast impostors by the WebGL program in `web_viewer.html`. The usual export (pyvista with trame) makes glyph
meshes: 12 MB for 12 000 spheres of one frame instead of half a megabyte, without a legend, and needs some forty packages
and the system libraries for drawing. Bodies are rigid: each frame holds six numbers of two bytes for each of them, position and
rotation vector. Rough plates are grids of heights of two bytes each, from which the page makes meshes.
"""

import base64
import html
import json
import re
from collections.abc import Sequence
from functools import reduce
from importlib.resources import files
from operator import or_
from pathlib import Path
from typing import NamedTuple

import numpy as np

from thirdbody.atomic_files import write_output
from thirdbody.palette import FIELD_STOPS, rgb, state_colors
from thirdbody.render.coloring import Legend
from thirdbody.render.picture_data import PictureData, read_picture_data
from thirdbody.render.surfaces import CONTACT, HEIGHTS, PlateSurface
from thirdbody.rotations import to_body
from thirdbody.trajectory.open_file import damage_as_fault
from thirdbody.trajectory.run_file import RunFile
from thirdbody.trajectory.states import code_name, state_counts
from thirdbody.units import with_unit

FINEST = 320  # largest number of points along the longer side of a rough plate: 270 kB of a page for a square plate
# Of all frames in a page: bytes before base64, which makes four of three; least and greatest number.
BYTES, FEW, MANY = 1_800_000, 5, 200
CURVE = 2000  # largest number of frames of a run of which all are points of the curves

Pictures = Sequence[PictureData]


class Axes(NamedTuple):
    """Coordinates of the page: hundredths of its width, from the middle of all frames."""

    middle: np.ndarray
    scale: float

    def of(self, points: np.ndarray) -> np.ndarray:
        """Return points (..., 3) [m] in them."""
        return (points - self.middle) * self.scale


def write_page(run: RunFile, numbers: Sequence[int], path: Path, color: str = "state", view: str = "iso", fps: int = 12) -> Path:
    """Write the page of frames of a run, evenly spaced ones of too many; return its path.

    `color` is that of `PictureOptions`, `view` the first one, `fps` the speed at which it plays. Raises InputError for an unknown
    array or a damaged run, OutputError when the file cannot be written.
    """
    with damage_as_fault(run.path, "its frames"):
        numbers = page_frames(sorted(numbers), read_picture_data(run, max(numbers), color))
        text = _page(run, numbers, color, {"view": view, "pause": 1000.0 / fps})
    write_output(path, text.encode("utf-8"))
    return path


def page_frames(numbers: Sequence[int], data: PictureData) -> list[int]:
    """Return the frames of a page, evenly spaced ones of `numbers`; `data` is that of one frame."""
    pose = 6 * len(data.radii) if data.quaternions is None else 12 * len(data.bodies)
    size = pose + 3 * len(data.bodies) + (6 * len(data.touching.points) if data.touching else 0)
    count = min(len(numbers), MANY, max(FEW, BYTES // size))
    return [numbers[k] for k in np.linspace(0, len(numbers) - 1, count).round().astype(int)]


def _page(run: RunFile, numbers: Sequence[int], color: str, options: dict[str, object]) -> str:
    scale = reduce(or_, (read_picture_data(run, number, color).legend for number in numbers))
    pictures = [read_picture_data(run, number, color, scale=scale) for number in numbers]
    legends = [[picture.legend] for picture in pictures]
    if color != "state" and run.has_states and len(numbers) > 1:
        for number, shown in zip(numbers, legends, strict=True):
            shown.append(read_picture_data(run, number, "state").legend)
    data = options | _scene(pictures) | _plates(run, numbers, pictures) | _particles(run, numbers) | _history(run, numbers)
    data |= {
        "numbers": list(numbers),
        "frames": run.frames,
        "facts": [picture.facts for picture in pictures],
        "words": [[words for legend in shown for words, _ in legend.entries] for shown in legends],
    }
    contents = {
        "@TITLE@": html.escape(pictures[-1].title or "thirdbody"),
        "@FACTS@": html.escape(pictures[-1].facts),
        "@LEGEND@": "".join(map(_legend, legends[-1])),
        # No tag inside a script may end it or begin another.
        "@DATA@": json.dumps(data).replace("<", "\\u003c"),
    }
    text = files("thirdbody.render").joinpath("web_viewer.html").read_text(encoding="utf-8")
    return re.sub("|".join(contents), lambda mark: contents[mark[0]], text)  # once: a title may hold another mark


def _axes(pictures: Pictures) -> tuple[Axes, np.ndarray]:
    # and the size (3,) [m] of what all frames show
    low, high = np.min([data.low for data in pictures], axis=0), np.max([data.high for data in pictures], axis=0)
    width = max((high - low)[:2].max(), pictures[0].radii.max())  # of plates without extent that of a body
    return Axes(0.5 * (low + high), 100.0 / float(width)), high - low


def _scene(pictures: Pictures) -> dict[str, object]:
    """Return shapes, poses and colours of all frames, and the space between the plates."""
    first, (axes, extent) = pictures[0], _axes(pictures)
    margin = 1.1 * float(first.radii.max(initial=0.0)) * axes.scale
    arm, part, positions = np.zeros_like(first.centers), np.arange(len(first.radii)), [data.centers for data in pictures]
    rotations = [data.quaternions for data in pictures if data.quaternions is not None]
    if rotations:  # spheres are rigid with their bodies, without orientations on their own
        part, positions = first.body, [data.bodies for data in pictures]
        arm = to_body(rotations[0][part], first.centers - first.bodies[part])
    centred = np.abs(arm).max(initial=0.0) < 1e-6 * first.radii.max(initial=0.0)  # rotations of such bodies are not visible
    return {
        "shapes": _packed(np.column_stack((arm, first.radii)) * axes.scale, "<f4"),  # centre in its body's axes, radius
        "parts": "" if rotations else _packed(part, "<i4"),  # none: those are the bodies
        "places": _steps(axes.of(np.stack(positions))),
        "rotations": "" if centred else _packed(np.rint(_rotation_vectors(np.stack(rotations)) * (32767.0 / np.pi)), "<i2"),
        "bodies": _packed(first.body, "<i4"),
        **_tones(pictures),
        "half": (0.5 * extent * axes.scale + [margin, margin, 0.0]).tolist(),
        "drag": [np.round(data.drag, 6).tolist() for data in pictures],
        "lengths": [
            {"label": with_unit(m * 10.0**p, "m"), "size": m * 10.0**p * axes.scale} for p in range(-9, 2) for m in (1, 2, 5)
        ],
    }


def _rotation_vectors(quaternions: np.ndarray) -> np.ndarray:
    # (..., 3), at most pi long: one step of 16 bits is everywhere a rotation by 1e-4 at most
    q = np.nan_to_num(quaternions.astype(np.float64))
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    return np.asarray(q[..., 1:] * np.divide(angle, sine, out=np.zeros_like(sine), where=sine > 0.0))


def _tones(pictures: Pictures) -> dict[str, object]:
    """Return the colours, and their numbers for each body (each sphere where they differ within one) in each frame (or once)."""
    colors, owner = np.stack([data.colors for data in pictures]).astype(np.int64), pictures[0].body
    palette, index = np.unique(colors @ np.array([65536, 256, 1]), return_inverse=True)
    index = index.reshape(colors.shape[:2])
    _, sphere = np.unique(owner, return_index=True)
    if len(sphere) == len(pictures[0].bodies) and np.array_equal(index[:, sphere][:, owner], index):
        index = index[:, sphere]
    if (index == index[0]).all():
        index = index[:1]
    tones = np.column_stack((palette >> 16, palette >> 8 & 255, palette & 255))
    return {
        "palette": _packed(tones, "u1"),
        "tones": _packed(index, "u1" if len(palette) <= 256 else "<u2"),
        "toned": index.shape[1],
    }


def _plates(run: RunFile, numbers: Sequence[int], pictures: Pictures) -> dict[str, object]:
    """Return the plates: surfaces of rough ones, the position of each in every frame, contacts with a rough lower one."""
    first, (axes, _) = pictures[0], _axes(pictures)
    positions: dict[str, list[list[float]]] = {}
    for side in ("lower", "upper"):
        if side in first.surfaces or (side == "upper" and first.has_upper):
            heights = [data.low[2] if side == "lower" else data.plate_height_over(data.low, data.high) for data in pictures]
            sideways = [run.surface_position(side, number)[:2] for number in numbers]
            positions[side] = axes.of(np.column_stack((sideways, heights))).tolist()
    on = [data.touching for data in pictures if data.touching is not None]
    contacts = [np.column_stack((axes.of(touching.points)[:, :2], touching.radius * axes.scale)) for touching in on]
    some = any(map(len, contacts))
    return {
        "plates": first.has_plates,
        "positions": positions,
        "surfaces": {side: _relief(surface, axes.scale) for side, surface in first.surfaces.items()},
        # x, y, radius, the contacts of one frame after those of another
        "contacts": _steps(np.concatenate(contacts)) | {"count": list(map(len, contacts))} if some else None,
        "marks": {"low": rgb(HEIGHTS[0]), "high": rgb(HEIGHTS[1]), "contact": rgb(CONTACT)},
    }


def _relief(surface: PlateSurface, scale: float) -> dict[str, object]:
    """Return one period of a rough plate: heights of a grid over its mean plane, row by row, upwards."""
    cells = surface.coefficients.shape[::-1]
    # a grid as fine as that of the surface shows all of it
    counts = [max(2, round(n * min(1.0, FINEST / max(cells)))) for n in cells]
    x, y = (start + np.arange(n) * (length / n) for start, length, n in zip(surface.position, surface.size, counts, strict=False))
    z = surface.sign * surface.heights(*np.meshgrid(x, y)) * scale
    return {"n": counts, "size": [length * scale for length in surface.size], "z": _steps(z[..., None])}


def _particles(run: RunFile, numbers: Sequence[int]) -> dict[str, object]:
    """Return what a click on a body shows: number, population, size, and its state with the reason in every frame."""
    bodies = run.bodies(numbers[-1])
    count = len(bodies["position"])
    codes, population = np.unique(bodies.get("population", np.zeros(0, np.int64)), return_inverse=True)
    data: dict[str, object] = {
        "ids": bodies.get("id", np.arange(count)).tolist(),
        "populations": [code_name(run.population_names, int(code)) for code in codes],
        "population": population.tolist(),
        "sizes": [f"diameter {with_unit(float(diameter), 'm')}" for diameter in bodies.get("diameter", ())],
    }
    if run.has_states:
        states, reasons = (_packed(codes[list(numbers)], "u1") for codes in (run.states, run.reasons))
        data["states"] = {"names": run.state_names, "colors": state_colors(run.state_names), "codes": states}
        data["reasons"] = {"names": [name.replace("_", " ") for name in run.reason_names], "codes": reasons}
    return data


def _history(run: RunFile, numbers: Sequence[int]) -> dict[str, object]:
    """Return friction and fractions of the states from the first to the last frame of the page; `at`: where its frames are."""
    if len(numbers) < 2:
        return {}
    span = np.arange(numbers[0], numbers[-1] + 1) if numbers[-1] - numbers[0] < CURVE else np.array(numbers)
    x, unit, axis = run.drag.distance[span], "m", "sliding distance"
    if not x[-1] > x[0]:
        x, unit, axis = run.times[span], "s", "time"
    mu = run.series.get("friction_coefficient", np.full(run.frames, np.nan))[span]
    counts = np.array(list(state_counts(run).values()))[:, span] if run.has_states else np.zeros((0, len(x)))
    return {
        "history": {
            "at": np.searchsorted(span, numbers).tolist(),
            "x": _packed((x - x[0]) / (x[-1] - x[0]), "<f4"),
            "axis": f"{axis} {with_unit(x[0], unit) if x[0] else 0} to {with_unit(x[-1], unit)}",
            "friction": _packed(mu, "<f4") if np.isfinite(mu).any() else "",
            "fractions": [_packed(row, "<f4") for row in counts / np.maximum(counts.sum(axis=0), 1)],
        }
    }


def _steps(values: np.ndarray) -> dict[str, object]:
    """Return the columns of an array (..., k) in 65535 steps each, from its lowest to its highest number."""
    columns = values.reshape(-1, values.shape[-1])
    low = columns.min(axis=0)
    step = (columns.max(axis=0) - low) / 65535.0
    numbers = np.rint((columns - low) / np.where(step > 0.0, step, 1.0))
    return {"low": low.tolist(), "step": step.tolist(), "steps": _packed(numbers, "<u2")}


def _packed(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def _legend(legend: Legend) -> str:
    caption = f"<small>{html.escape(legend.caption)}</small>" if legend.caption else ""
    if legend.limits is None:
        entry = '<span class="entry"><i style="background:{}"></i>{}</span>'
        entries = [entry.format(color, html.escape(words)) for words, color in legend.entries]
        return "".join([f"<b>{html.escape(legend.title)}</b>" if legend.title else "", *entries, caption])
    title, ticks = legend.scale()
    marks = "".join(f'<span style="left:{100.0 * left:.2f}%">{number}</span>' for left, number in ticks)
    bar = f'<div class="bar" style="background:linear-gradient(90deg,{",".join(FIELD_STOPS)})"></div>'
    return f'<b>{html.escape(title)}</b><div class="scale">{bar}{marks}</div>{caption}'
