"""Texts of a run file (`/scene`), read only after their claimed sizes have been checked."""

import json
from typing import Any

import h5py


def refuse_false_texts(group: h5py.Group) -> None:
    """Raise ValueError for a text that claims more than its file has, TypeError for what is none."""
    for dataset in group.values():
        kind = dataset.id.get_type() if isinstance(dataset, h5py.Dataset) and dataset.shape == () else None
        if kind is None or kind.get_class() != h5py.h5t.STRING or kind.is_variable_str():
            raise TypeError(f"{dataset.name} is no text of fixed length")
        size, there = kind.get_size(), dataset.file.id.get_filesize()
        if size > there:
            raise ValueError(f"{dataset.name} claims {size:.3g} bytes, and the whole file has {there:.3g}")


def read_text(dataset: h5py.Dataset) -> Any:
    """Return the text, or its content if it is JSON."""
    text = dataset[()].decode("utf-8")
    return json.loads(text) if dataset.attrs["json"] else text
