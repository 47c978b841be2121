"""The texts of a run file (`/scene`): read only after their claimed sizes have been looked at."""

from __future__ import annotations

import json
from typing import Any

import h5py

MOST_TEXT = 1 << 28
"""Bytes of all texts of a run together: the resolved scene of a million positions has some 60 MB."""

MOST_JSON = 1 << 24
"""Bytes of those that are JSON (names, units, the summary), which takes up to 30 times as much once it is read."""


def refuse_large_texts(group: h5py.Group) -> None:
    """Raise ValueError or TypeError for texts that are too large together, larger than their file, or no texts."""
    sizes = {name: _size(group[name]) for name in group}
    json_size = sum(size for name, size in sizes.items() if group[name].attrs["json"])
    for what, size, maximum in (("texts", sum(sizes.values()), MOST_TEXT), ("JSON texts", json_size, MOST_JSON)):
        if size > maximum:
            raise ValueError(f"its {what} claim {size:.3g} bytes, at most {maximum:.3g} are read")


def _size(dataset: h5py.Dataset) -> int:
    """Bytes that the text claims. Raises ValueError when the file cannot hold them, TypeError for what is no text."""
    if not isinstance(dataset, h5py.Dataset) or dataset.shape != () or dataset.id.get_type().get_class() != h5py.h5t.STRING:
        raise TypeError(f"{dataset.name} is no text")
    if dataset.id.get_type().is_variable_str():
        raise TypeError(f"{dataset.name} is a text of variable length")
    size, there = dataset.id.get_type().get_size(), dataset.file.id.get_filesize()
    if size > there:
        raise ValueError(f"{dataset.name} claims {size:.3g} bytes, and the whole file has {there:.3g}")
    return int(size)


def read_text(dataset: h5py.Dataset) -> Any:
    """The text, or what it holds as JSON."""
    text = dataset[()].decode("utf-8")
    return json.loads(text) if dataset.attrs["json"] else text
