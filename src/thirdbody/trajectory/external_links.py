"""Refusal of run files that refer to anything outside themselves; checked before anything is read through a link.

HDF5 can store a link to another file, data in another file, and filters that it loads as code. Opening these could block for ever
(a pipe), read files that the user did not name, or run foreign code; no run needs them.
"""

import h5py

MAX_LINKS = 10_000
"""Largest number of links in a run file: a run has some hundred, and one for each array that a law or an effect records."""

_FILTERS = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32)


def refuse_foreign(file: h5py.File) -> None:
    """Raise ValueError for a link or data outside the file, a filter that runs other code, and too many links.

    Only hard links are followed, each object once; the target of a soft link also has a hard link.
    """
    groups, visited, links = [file["/"]], {_address(file["/"])}, 0
    while groups:
        group = groups.pop()
        links += len(group)
        if links > MAX_LINKS:
            raise ValueError(f"holds more than {MAX_LINKS} links, the most that are read")
        for name in group:
            kind = group.id.links.get_info(name.encode("utf-8", "surrogateescape")).type
            if kind not in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT):
                raise ValueError(f"{group.name.rstrip('/')}/{name} is a link to another file")
            if kind == h5py.h5l.TYPE_SOFT:
                continue
            node = group[name]
            if _address(node) in visited:
                continue
            visited.add(_address(node))
            if isinstance(node, h5py.Group):
                groups.append(node)
            elif isinstance(node, h5py.Dataset):
                _refuse_storage(node)


def _address(node: h5py.HLObject) -> int:
    """Return the address of the object in the file."""
    return int(h5py.h5o.get_info(node.id).addr)


def _refuse_storage(dataset: h5py.Dataset) -> None:
    """Raise ValueError for data in other files, and for filters that are not part of HDF5 itself."""
    plan = dataset.id.get_create_plist()
    if plan.get_layout() == h5py.h5d.VIRTUAL or plan.get_external_count():
        raise ValueError(f"{dataset.name} has its data in another file")
    for index in range(plan.get_nfilters()):
        if (number := plan.get_filter(index)[0]) not in _FILTERS:
            raise ValueError(f"{dataset.name} needs the filter {number}, which is not used by runs")
