"""The rows of a sphere's contacts with a rough plate: what a search does with those that exist."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from thirdbody.kernels import surface_minima
from thirdbody.kernels.columns import height_field, surface_contact
from thirdbody.kernels.nearby_minima import MERGE
from thirdbody.kernels.predicates import BASINS

X = surface_contact.OFFSET


def searched(monkeypatch: pytest.MonkeyPatch, rows: list[float], minima: list[float]) -> tuple[np.ndarray, int]:
    """Search a sphere with minima at these x where these are found, nearest first; return the rows of two, and its bits.

    In Python, with cells of 1 m: what is found, and where a minimum is followed to, is told.
    """

    def find_minima(field, centre, farthest, found):
        found[: len(minima), 0], found[: len(minima), 1], found[: len(minima), 2] = minima, 0.0, 1.0
        return len(minima)

    def follow(k, field, x, start, tables):
        Q[k, X], Q[k, X + 1] = start

    for helper in (surface_minima.is_same, surface_minima.offset_of, surface_minima.has_minimum,
                   surface_minima.set_minimum, surface_minima.end_minimum):  # fmt: skip
        monkeypatch.setattr(surface_minima, helper.py_func.__name__, helper.py_func)
    monkeypatch.setattr(surface_minima, "find_minima", find_minima)
    monkeypatch.setattr(surface_minima, "follow", follow)
    field, Q = np.zeros(height_field.WIDTH), np.zeros((2 * BASINS, surface_contact.WIDTH))
    field[[height_field.RATE_X, height_field.RATE_Y]] = 1.0
    Q[: len(rows), X], Q[0, surface_contact.MINIMA] = rows, (1 << len(rows)) - 1
    surface_minima.search_all.py_func(0, field, (0.0, 0.0, 0.0), (2.0, 1.0), SimpleNamespace(Q=Q))
    return Q, int(Q[0, surface_contact.MINIMA])


def test_of_two_rows_at_one_minimum_one_keeps_it(monkeypatch):
    # both are within the tolerance of 2 MERGE of the minimum at 0, but farther than it from each other
    apart = 1.5 * MERGE
    Q, bits = searched(monkeypatch, [-apart, apart], [float(m) for m in range(BASINS)])
    assert bits == (1 << BASINS) - 1
    assert Q[:BASINS, X].tolist() == [-apart] + [float(m) for m in range(1, BASINS)]
    assert not Q[BASINS:].any()  # the rows of the next sphere


def test_rows_keep_their_places_and_new_minima_get_the_free_ones(monkeypatch):
    Q, bits = searched(monkeypatch, [5.0, 6.0, 7.0], [3.0, 7.0, 5.0])
    assert bits == 0b111 and Q[:3, X].tolist() == [5.0, 3.0, 7.0]
    assert int(Q[0, surface_contact.ENDED]) == 0b010
