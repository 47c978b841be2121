"""Texts of a run file (`/scene`), read only after their claimed sizes have been checked."""

import json
from typing import Any

import h5py

MAX_TEXT = 1 << 28
"""Limit of all texts of a run together [bytes]: the resolved scene of a million positions has some 60 MB."""

MAX_JSON = 1 << 24
"""Limit of JSON texts (names, units, the summary) [bytes]; parsed they occupy up to 30 times as much."""


def refuse_large_texts(group: h5py.Group) -> None:
    """Raise ValueError or TypeError for texts that are too large together, larger than their file, or not texts."""
    sizes = {name: _size(group[name]) for name in group}
    json_size = sum(size for name, size in sizes.items() if group[name].attrs["json"])
    for what, size, maximum in (("texts", sum(sizes.values()), MAX_TEXT), ("JSON texts", json_size, MAX_JSON)):
        if size > maximum:
            raise ValueError(f"its {what} claim {size:.3g} bytes, at most {maximum:.3g} are read")


def _size(dataset: h5py.Dataset) -> int:
    """Return the claimed size of a text [bytes]. Raises ValueError when the file cannot hold it, TypeError for other data."""
    if not isinstance(dataset, h5py.Dataset) or dataset.shape != () or dataset.id.get_type().get_class() != h5py.h5t.STRING:
        raise TypeError(f"{dataset.name} is no text")
    if dataset.id.get_type().is_variable_str():
        raise TypeError(f"{dataset.name} is a text of variable length")
    size, there = dataset.id.get_type().get_size(), dataset.file.id.get_filesize()
    if size > there:
        raise ValueError(f"{dataset.name} claims {size:.3g} bytes, and the whole file has {there:.3g}")
    return int(size)


def read_text(dataset: h5py.Dataset) -> Any:
    """Return the text, or its content if it is JSON."""
    text = dataset[()].decode("utf-8")
    return json.loads(text) if dataset.attrs["json"] else text
