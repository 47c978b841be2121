"""Pressure maps of the upper body from CSV files, and the load of any pressure profile."""

from typing import NamedTuple

import numpy as np

from thirdbody.assembly.csv_table import Report, Rows, numbers_of
from thirdbody.scene.model import Scene
from thirdbody.scene.pressure import Hertz, PressureMap, Profile
from thirdbody.units import pretty

Array = np.ndarray

EVEN = 0.01
"""Largest distance of a position from a regular grid over its spacing: positions may be rounded."""

NEGLIGIBLE = 1e-6
"""Pressure over the largest one below which a node is outside the contact: what is left of rounding carries no body."""

NOTABLE = 0.01
"""Pressure over the largest one from which it counts for the half width of a map."""


class Map(NamedTuple):
    """Pressure [Pa] and gap [m] at the nodes of a regular grid, (n_y, n_x): its first node and its spacing [m]."""

    first: Array
    spacing: Array
    pressure: Array
    gap: Array

    @property
    def integral(self) -> float:
        """Load [N]: the pressure is bilinear between nodes, and 0 outside."""
        weights = [np.where(np.isin(np.arange(n), (0, n - 1)), 0.5, 1.0) for n in self.pressure.shape]
        return float(weights[0] @ self.pressure @ weights[1] * self.spacing[0] * self.spacing[1])

    @property
    def half_width(self) -> float:
        """Half the width [m] along x of the nodes with a notable pressure, at least half a spacing."""
        columns = np.flatnonzero(self.pressure.max(axis=0) > NOTABLE * self.pressure.max())
        return 0.5 * float(self.spacing[0]) * max(int(columns[-1] - columns[0]), 1)

    def border_pressure(self, size: tuple[float, float]) -> float:
        """Return the largest pressure [Pa] at a border of the map that lies in a domain of this size [m]."""
        last = self.first + self.spacing * (np.array(self.pressure.shape[::-1]) - 1)
        sides = [(self.first, 0), (last, -1)]
        borders = [self.pressure.take(k, 1 - axis) for at, k in sides for axis in range(2) if abs(at[axis]) < 0.5 * size[axis]]
        return max((float(border.max()) for border in borders), default=0.0)


def load_of(scene: Scene, given: Profile) -> float:
    """Return the load of a pressure profile [N]. Raises InputError for a map that cannot be read."""
    if isinstance(given, Hertz) and given.load_per_length is not None:
        return given.load_per_length * scene.domain.size[1]
    if isinstance(given, PressureMap) and given.load is None:
        return read_map(scene, given).integral
    assert given.load is not None
    return given.load


def read_map(scene: Scene, given: PressureMap) -> Map:
    """Return the map in the file of a profile. Raises InputError with the line of a fault."""
    names = {"x": "length", "y": "length", "pressure": "pressure"}
    rows, fault = numbers_of(scene, ("plates", "upper", "pressure", "table"), given.table, names, {"gap": "length"})
    if not rows:
        raise fault("holds no rows of numbers")
    for line, (_, _, *quantities) in rows:
        for (name, kind), value in zip((("pressure", "pressure"), ("gap", "length")), quantities, strict=False):
            if value < 0.0:
                raise fault(f"line {line}: {name} {pretty(value, kind)} must be at least 0")
    values = np.array([numbers for _, numbers in rows])
    (first_x, step_x, i), (first_y, step_y, j) = (_nodes(axis, values[:, axis], rows, fault) for axis in range(2))
    n_x, n_y = int(i.max()) + 1, int(j.max()) + 1
    cells, counts = np.unique(j * n_x + i, return_counts=True)
    if np.any(counts > 1):
        again = np.flatnonzero(j * n_x + i == cells[np.argmax(counts > 1)])[1]
        raise fault(f"line {rows[again][0]}: {_position(*values[again, :2])} occurs twice")
    if len(cells) < n_x * n_y:
        lacking = int(np.setdiff1d(np.arange(n_x * n_y), cells)[0])
        missing = _position(first_x + lacking % n_x * step_x, first_y + lacking // n_x * step_y)
        raise fault(f"has {len(cells)} rows for {n_x} x {n_y} nodes: {missing} is missing")
    order = np.argsort(j * n_x + i)
    pressure, *gap = [values[order, k].reshape(n_y, n_x) for k in range(2, values.shape[1])]
    pressure[pressure < NEGLIGIBLE * pressure.max()] = 0.0
    if not pressure.any():
        raise fault("the pressure is zero everywhere")
    return Map(np.array([first_x, first_y]), np.array([step_x, step_y]), pressure, gap[0] if gap else np.zeros_like(pressure))


def _position(x: float, y: float) -> str:
    return f"x {pretty(x, 'length')}, y {pretty(y, 'length')}"


def _nodes(axis: int, values: Array, rows: Rows, fault: Report) -> tuple[float, float, Array]:
    """Return the first position along an axis [m], the spacing [m], and the number of the node of each row."""
    name, positions = "xy"[axis], np.unique(values)
    steps = np.diff(positions)
    steps = steps[steps > EVEN * steps.max(initial=0.0)]
    if not len(steps):
        raise fault(f"needs at least two different {name}")
    usual = float(np.median(steps))
    nodes = np.rint((values - positions[0]) / usual)
    step = float(np.ptp(values)) / float(nodes.max())
    off = np.abs(values - positions[0] - step * nodes) > EVEN * step
    if off.any():
        k = int(np.argmax(off))
        value, spacing = pretty(values[k], "length"), pretty(step, "length")
        raise fault(f"line {rows[k][0]}: {name} {value} is not on a regular grid of {spacing}")
    return float(positions[0]), step, nodes.astype(np.int64)
