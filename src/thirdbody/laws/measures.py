"""Measures: plug-ins that read what contacts do in each step, and change nothing.

A measure has a kernel `kernel(s, p)` of a `ContactStep` and its parameters, which returns one float per `Amount`. The engine
collects them per contact, per body and, where an amount names a map, over the surfaces of both plates. No law, no body and no
step length depends on them: a run with measures has the bits of one without.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from thirdbody.laws.compose import HEAD, fields_of, import_lines
from thirdbody.laws.contract import MAXIMUM, MEAN, SUM, Amount, Measure
from thirdbody.laws.generated import load_module

ADD, MAX = 0, 1  # codes of the two operations in `Layout.targets`


class Output(NamedTuple):
    """What a body has of a measure, or a map of both plates: name, unit, meaning; `kind` as of the amount."""

    name: str
    unit: str
    doc: str
    kind: str = SUM


class Layout(NamedTuple):
    """Where measures keep their numbers.

    `targets` (contact columns, 5): for each number of a contact behind its contact radius the operation, the column of the body
    for contacts with the lower plate, with the upper plate and with debris, and the map; -1: none. Sums come before maxima. The
    time in which contacts were closed, which means are divided by, is column `time` of the body; -1: there are no means."""

    bodies: tuple[Output, ...]
    maps: tuple[Output, ...]
    maxima: tuple[tuple[str, str, str], ...]
    targets: np.ndarray
    sums: int
    time: int

    @property
    def width(self) -> int:
        return 1 + len(self.targets)

    def units(self) -> dict[str, str]:
        return {name: unit for name, unit, *_ in (*self.bodies, *self.maps, *self.maxima)}


def by_kind(measures: Sequence[Measure]) -> tuple[list[tuple[int, int, Amount]], list[tuple[int, int, Amount]]]:
    """Return every sum and mean, and every maximum: number of the measure, number of the amount in it, amount."""
    amounts = [(k, i, amount) for k, measure in enumerate(measures) for i, amount in enumerate(measure.amounts)]
    return [entry for entry in amounts if entry[2].kind != MAXIMUM], [entry for entry in amounts if entry[2].kind == MAXIMUM]


def layout_of(measures: Sequence[Measure]) -> Layout:
    """Return where these measures keep their numbers. Raises ValueError where two of them have an amount of one name."""
    summands, largest = by_kind(measures)
    bodies: list[Output] = []
    maps: list[Output] = []
    targets: list[tuple[int, ...]] = []
    time = -1
    for _, _, amount in summands:
        if amount.of_plate:
            targets.append((ADD, len(bodies), len(bodies) + 1, -1, len(maps) if amount.map else -1))
            maps += [Output(*amount.map, amount.doc)] if amount.map else []
            for side in ("lower", "upper"):
                doc = f"{amount.doc.rstrip('.').replace('the plate', f'the {side} plate')}."
                bodies.append(Output(f"{amount.name}_{side}", amount.unit, doc))
        else:
            targets.append((ADD, *(3 * (len(bodies),)), -1))
            bodies.append(Output(amount.name, amount.unit, amount.doc, amount.kind))
    if any(amount.kind == MEAN for _, _, amount in summands):
        time = len(bodies)
        targets.append((ADD, time, time, time, -1))
        bodies.append(Output("measured_time", "s", "Time of closed contacts in the drag, summed over contacts."))
    sums = len(targets)
    for _, _, amount in largest:
        targets.append((MAX, *(3 * (len(bodies),)), -1))
        bodies.append(Output(amount.name, amount.unit, amount.doc, MAXIMUM))
    names = [entry.name for entry in (*bodies, *maps)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"two amounts of measures have the name {', '.join(twice)}")
    maxima = tuple((amount.name, amount.unit, amount.doc) for _, _, amount in largest)
    return Layout(tuple(bodies), tuple(maps), maxima, np.array(targets, np.int64).reshape(-1, 5), sums, time)


def measures_text(measures: Sequence[Measure]) -> str:
    """Return the text of the module: each kernel is called once; its amounts go to the columns behind the contact radius."""
    lines, counts = [], [len(fields_of(measure)) for measure in measures]
    for k in range(len(measures)):
        values = ", ".join(f"parameters[row * {sum(counts)} + {sum(counts[:k]) + i}]" for i in range(counts[k]))
        lines.append(f"r{k} = kernel_{k}(s, parameters_{k}({values}))")
    lines.append("H[k, at] = s.contact_radius if s.contact_radius > 0.0 else H[k, at]")
    summands, largest = by_kind(measures)
    added = [f"{'s.dt * ' if amount.kind == MEAN else ''}r{k}[{i}]" for k, i, amount in summands]
    added += ["s.dt"] if any(amount.kind == MEAN for _, _, amount in summands) else []
    lines += [f"H[k, at + {column}] += {value}" for column, value in enumerate(added, 1)]
    for column, (k, i, _) in enumerate(largest, len(added) + 1):
        lines.append(f"H[k, at + {column}] = max(H[k, at + {column}], r{k}[{i}])")
    head = HEAD.format(" + ".join(measure.name for measure in measures)) + "\n".join(import_lines(measures))
    loop = "\n\n\n@njit(MEASURE, **OPTIONS)\ndef measure(s, row, H, k, at, parameters):\n"
    return head + loop + "".join(f"    {line}\n" for line in lines)


def compose_measures(measures: Sequence[Measure]) -> Callable:
    return load_module("measure", measures_text(measures), [measure.kernel for measure in measures])[0].measure
