"""Colours of a picture: bodies by a category (state, reason, ...) or by a number, with the legend.

No drawing here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thirdbody.errors import InputError, nearest
from thirdbody.palette import category_colors, field_colors, rgb, state_colors
from thirdbody.trajectory.names import ARRAY_UNITS, CLUMPS, CONTACTS, SPHERES
from thirdbody.trajectory.read_blocks import rows_of
from thirdbody.trajectory.run_file import RunFile
from thirdbody.trajectory.states import code_name
from thirdbody.units import prefix_for, ticks

Arrays = dict[str, np.ndarray]

# Common short names of arrays.
ALIASES = {"reason": "state_reason", "speed": "velocity"}

# Codes that are not bytes.
NUMBERED = ("population", "material")


@dataclass(frozen=True)
class Legend:
    """States with their colours and counts, and (when `limits` is set) the limits of a colour scale in `unit`.

    `codes` are those of the entries, `total` is the sum of the counts, `caption` explains the words.
    """

    title: str = ""
    entries: tuple[tuple[str, str], ...] = ()
    limits: tuple[float, float] | None = None
    unit: str = ""
    codes: tuple[int, ...] = ()
    total: int = 0
    caption: str = ""

    def __or__(self, other: Legend) -> Legend:
        """Return what two frames of a film have in common: the limits of the colour scale, the codes."""
        limits = [legend.limits for legend in (self, other) if legend.limits is not None]
        ends = (min(low for low, _ in limits), max(high for _, high in limits)) if limits else None
        return Legend(limits=ends, codes=tuple(sorted({*self.codes, *other.codes})))

    def scale(self) -> tuple[str, list[tuple[float, str]]]:
        """Return the title of the colour scale with its unit, and its ticks: their places, 0 to 1, and their numbers."""
        low, high = self.limits or (0.0, 0.0)
        factor, unit = prefix_for(max(abs(low), abs(high)), self.unit)
        low, high = low * factor, high * factor
        marks = [((value - low) / (high - low) if high > low else 0.5, f"{value:.6g}") for value in ticks(low, high)]
        return self.title + (f", {unit}" if unit else ""), marks


def scale_colors(values: np.ndarray, legend: Legend) -> np.ndarray:
    """Return the colours (n, 3) uint8 of numbers."""
    low, high = legend.limits or (0.0, 0.0)
    # A field of one value has the middle colour.
    return field_colors((values - low) / (high - low) if high > low else values - low + 0.5)


def compute_coloring(
    run: RunFile, frame: int, color: str, bodies: Arrays, spheres: Arrays, row: np.ndarray, scale: Legend
) -> tuple[np.ndarray, Legend, np.ndarray | None]:
    """Return the colours of the spheres (S, 3) uint8, their legend, and those of the contacts (C, 3) where these have the array.

    `row` (S,) is the row of each sphere's body, `scale` that of the film or empty. Raises InputError for an unknown array.
    """
    name = ALIASES.get(color, color)
    if name in bodies and (bodies[name].dtype == np.uint8 or name in NUMBERED):
        return _categories(run, name, bodies[name], row, scale.codes)
    contacts = run.contacts(frame) if run.has_contacts else {}
    # `velocity_x` names a component
    vector, axis = (name[:-2], "xyz".index(name[-1])) if name[-2:] in ("_x", "_y", "_z") else (name, -1)
    if axis >= 0 and vector in bodies and bodies[vector].shape[1:] == (3,):  # a quaternion begins with w
        values = bodies[vector][row, axis]
    elif name in bodies:
        values = _length(bodies[name][row])
    elif name in spheres:
        values = _length(spheres[name])
    elif name in contacts and "body" in contacts:
        largest, amounts = np.full(len(bodies["position"]), -np.inf), _length(contacts[name])
        for side in {"body", "partner"} & set(contacts):
            real = contacts[side] >= 0  # a plate is a partner below 0
            np.maximum.at(largest, rows_of(bodies, contacts[side][real]), amounts[real])
        values = np.where(np.isneginf(largest), np.nan, largest)[row]
    else:
        names = set(bodies) | set(spheres) | set(contacts)
        known = (names | {short for short, long in ALIASES.items() if long in names}) - {"position"}
        raise InputError(f"color: this run has no array '{color}'; {nearest(color, known)}")
    tubes = _length(contacts[name]) if name in contacts else None
    finite = values[np.isfinite(values)]
    if tubes is not None and name in bodies:
        finite = np.concatenate([finite, tubes[np.isfinite(tubes)]])
    limits = scale.limits or ((float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0))
    unit = ARRAY_UNITS.get(color) or ARRAY_UNITS.get(vector) or run.header["units"].get(color, "")
    title, meaning = color.replace("_", " "), _meaning(run, vector, name in contacts and name not in bodies | spheres)
    caption = f"{title}: {meaning}" if meaning else ""
    legend = Legend(title, limits=limits, unit=unit.replace("1", ""), caption=caption)
    return scale_colors(values, legend), legend, None if tubes is None else scale_colors(tubes, legend)


def _meaning(run: RunFile, name: str, of_contact: bool) -> str:
    """Return what an array means, in words that follow its name; empty where nothing tells it."""
    named = {key: entry.meaning for key, entry in (CONTACTS if of_contact else SPHERES | CLUMPS).items()}
    text = (named | run.header.get("meanings", {})).get(name, "").partition(", (")[0].rstrip(".")
    return text[:1].lower() + text[1:] + ", the largest of its contacts" * (of_contact and bool(text))


def _categories(
    run: RunFile, name: str, codes: np.ndarray, row: np.ndarray, shown_codes: tuple[int, ...]
) -> tuple[np.ndarray, Legend, None]:
    if name in ("state", "state_reason"):
        names = run.state_names if name == "state" else run.reason_names
    else:
        known = {"population": run.population_names, "material": run.material_names}.get(name, [])
        names = [code_name(known, code) for code in range(int(codes.max(initial=max(shown_codes, default=0))) + 1)]
    colors = state_colors(names) if name == "state" else category_colors(len(names))
    counts = np.bincount(codes, minlength=len(names))
    total = max(1, int(counts.sum()))
    # All states are shown, so that every picture of a run has the same legend; of other codes those that occur.
    shown = [code for code in range(len(names)) if name == "state" or counts[code] or code in shown_codes]
    words = [f"{names[code].replace('_', ' ')}  {counts[code]}  ({100.0 * counts[code] / total:.0f} %)" for code in shown]
    entries = tuple((text, colors[code]) for text, code in zip(words, shown, strict=True))
    title = {"state": "", "state_reason": "reason"}.get(name, name.replace("_", " "))
    meanings = run.header.get("meanings", {}) if name in ("state", "state_reason") else {}
    caption = "; ".join(f"{names[code].replace('_', ' ')}: {meanings[names[code]]}" for code in shown if names[code] in meanings)
    legend = Legend(title, entries, codes=tuple(shown), total=total, caption=caption)
    palette = np.array([rgb(color) for color in colors], np.uint8)
    return palette[codes[row].astype(np.int64)], legend, None


def _length(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(values, axis=1) if values.ndim == 2 else values.astype(np.float64)
