"""Elastic interaction, neglected even by the finest level: contacts of one body depress the surface under each other.

Hertz and Mindlin hold for a single contact on a half-space. The next level of accuracy is a boundary-element solution of all
contacts of a body on one plate, by tamaas (L. Frerot et al., J. Open Source Software 5, 2020) where it is installed; in addition,
or without it, there is the closed form for distant contacts, where a neighbour acts like a point load (Boussinesq; K.L. Johnson,
Contact Mechanics, 1985, Eq. 3.22a). In both the two partners of a contact are treated together as one half-space with the pair's
E*: an upper bound of the interaction, as a debris particle is not a half-space.

Tangentially the same fraction holds: a sliding neighbour moves the surface by mu N/(pi G* r), averaged over directions (Cerruti;
Johnson, Eq. 3.75); its ratio to s_c = mu E* d/G* is that of N/(pi E* r) to the overlap d.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.studies.cost import Study
from thirdbody.studies.worker_process import RUNS
from thirdbody.trajectory.names import LOWER_PLATE, UPPER_PLATE

Array = np.ndarray

CELLS, MARGIN, MAX_CELLS = 12, 2.0, 1600
"""Grid cells over the smallest contact radius, empty rim in largest contact radii, and largest number of cells along a side."""


@dataclass(frozen=True)
class Spots:
    """Loaded contacts (n) of one body on one plate, SI: `position` (n, 2), `overlap`, `radius` (of contact), `load` (n,)."""

    body: int
    plate: str
    position: Array
    overlap: Array
    radius: Array
    load: Array

    @property
    def e_star(self) -> float:
        """E* of the pair [Pa], from Hertz: N = (4/3) E* a d."""
        return float(np.mean(3.0 * self.load / (4.0 * self.radius * self.overlap)))

    @property
    def apart(self) -> Array:
        """Distances (n, n) [m]; infinite from a contact to itself."""
        r = np.linalg.norm(self.position[:, None] - self.position[None], axis=2)
        np.fill_diagonal(r, math.inf)
        return r

    @property
    def neighbour_fraction(self) -> float:
        """Fraction of a contact's overlap due to its neighbours' loads: sum of N/(pi E* r) over the overlap.

        The mean over the contacts, weighted with their loads: a contact that hardly touches has the largest error and the least
        influence.
        """
        fractions = (self.load / (math.pi * self.e_star * self.apart)).sum(axis=1) / self.overlap
        return float(np.average(fractions, weights=self.load))


def interaction(folder: Path) -> dict[str, Any] | None:
    """Return the interaction neglected at the closest contacts of a run; None if no body has two loaded contacts on one plate.

    `neighbour_fraction`: fraction of a contact's overlap (`Spots.neighbour_fraction`); `closed_form` and `boundary_elements`
    (None without tamaas, reason in `why`): `approach`, the relative change of the approach of the whole group under the same
    load, and `loads`, that of each contact's load when the group is pressed as one rigid body.
    """
    spots = closest(folder)
    if spots is None:
        return None
    nearest = float(np.min(spots.apart / np.maximum(spots.radius[:, None], spots.radius[None])))
    report: dict[str, Any] = {
        "body": spots.body, "plate": spots.plate, "spots": len(spots.load), "nearest": nearest,
        "neighbour_fraction": spots.neighbour_fraction, "closed_form": far_field(spots), "boundary_elements": None, "why": "",
    }  # fmt: skip
    try:
        import tamaas
    except ImportError:
        return report | {"why": "tamaas is not installed (pip install 'thirdbody[bem]'): closed form only, no boundary elements"}
    report["versions"] = {"tamaas": tamaas.__version__}
    try:
        return report | {"boundary_elements": boundary_element_forces(tamaas, spots)}
    except ValueError as problem:
        return report | {"why": f"no boundary elements: {problem}"}


def above(built: Study, folder: Path) -> dict[str, Any] | None:
    """Return `interaction` of the study's reference."""
    name = built.reference.folder
    return interaction(folder / RUNS / name) if name else None


def closest(folder: Path) -> Spots | None:
    """Return the group of contacts with the largest neglected fraction at the end of settling (last frame before the drag)."""
    from thirdbody.trajectory.reader import open_run

    with open_run(folder) as run:
        distance = run.series["distance"]
        moved = np.flatnonzero(distance > 1e-3 * distance[-1])  # the step at which the drag starts extends a little beyond
        frame = max(0, int(moved[0]) - 1) if len(moved) else run.frames - 1
        table = run.contacts(frame)
    result = []
    for partner, plate in ((LOWER_PLATE, "lower"), (UPPER_PLATE, "upper")):
        here = (table["partner"] == partner) & (table["overlap"] > 0.0)
        for body in np.unique(table["body"][here]):
            k = np.flatnonzero(here & (table["body"] == body))
            if len(k) > 1:
                result.append(Spots(int(body), plate, table["position"][k, :2], table["overlap"][k], table["contact_radius"][k],
                                   table["normal_force"][k]))  # fmt: skip
    return max(result, key=lambda spots: spots.neighbour_fraction, default=None)


def far_field(spots: Spots) -> dict[str, Any]:
    """Return approach and loads of the group as one rigid body, each neighbour a point load, by Newton's method."""
    n, e = len(spots.load), spots.e_star
    stiff = spots.load / spots.overlap**1.5
    bend = 1.0 / (math.pi * e * spots.apart)
    down, lift = spots.overlap.copy(), 0.0
    for _ in range(50):  # converges quadratically: a handful is enough
        force = stiff * down**1.5
        slope = 1.5 * stiff * np.sqrt(down)
        residual = np.append(spots.overlap + lift - bend @ force - down, spots.load.sum() - force.sum())
        matrix = np.zeros((n + 1, n + 1))
        matrix[:n, :n] = np.eye(n) + bend * slope
        matrix[:n, n], matrix[n, :n] = -1.0, slope
        step = np.linalg.solve(matrix, residual)
        down, lift = np.maximum(down + step[:n], 1e-3 * spots.overlap), lift + step[n]
    return _relative_changes(spots, lift, stiff * down**1.5)


def boundary_element_forces(tamaas: Any, spots: Spots) -> dict[str, Any]:
    """Return the same by boundary elements, corrected by the grid error of a lone contact: each is solved alone first.

    Raises ValueError for contacts that merge, or that are too far apart for a grid.
    """
    if float(np.min(spots.apart / (spots.radius[:, None] + spots.radius[None]))) < 1.0:
        raise ValueError("the spots' contacts overlap")
    tamaas.set_log_level(tamaas.LogLevel.error)
    cell = float(spots.radius.min()) / CELLS
    rim = MARGIN * float(spots.radius.max())
    low, high = spots.position.min(axis=0) - rim, spots.position.max(axis=0) + rim
    n = np.ceil((high - low) / cell).astype(int)
    if n.max() > MAX_CELLS:
        raise ValueError(f"the grid would have {n.max()} cells along a side, at most {MAX_CELLS}")
    axes = [low[i] + cell * np.arange(n[i]) for i in (0, 1)]
    gap = [((axes[0][:, None] - x) ** 2 + (axes[1][None] - y) ** 2) * spots.overlap[k] / (2.0 * spots.radius[k] ** 2)
           for k, (x, y) in enumerate(spots.position)]  # fmt: skip
    # a lone contact fills only its corner of the grid: the same to 1e-8 and three hundred times as fast
    near = [np.ix_(*(np.abs(axes[i] - spots.position[k, i]) < rim for i in (0, 1))) for k in range(len(gap))]
    alone = np.array([_pressed(tamaas, spots, cell, gap[k][near[k]], spots.load[k])[1] for k in range(len(gap))])
    heights = np.stack([gap[k] + (alone.max() - alone[k]) for k in range(len(gap))])
    pressure, approach = _pressed(tamaas, spots, cell, heights.min(axis=0), spots.load.sum())
    owner = heights.argmin(axis=0)
    loads = np.array([pressure[owner == k].sum() * cell**2 for k in range(len(gap))])
    # relative to the lone contact's overlap, scaled by the scene's: the error of the grid cancels to first order
    return _relative_changes(spots, (approach - alone.max()) / alone.max() * spots.overlap.max(), loads)


def _pressed(tamaas: Any, spots: Spots, cell: float, gap: Array, load: float) -> tuple[Array, float]:
    """Return pressure (n, m) [Pa] and approach [m] of a rigid surface `gap` above a half-space, under `load` [N].

    The half-space has the pair's E* and is not periodic. Polonsky and Keer's conjugate gradients (Wear 231, 1999), in units of
    the largest overlap and contact radius.
    """
    a, d = float(spots.radius.max()), float(spots.overlap.max())
    size = [gap.shape[0] * cell / a, gap.shape[1] * cell / a]
    model = tamaas.Model(tamaas.model_type.basic_2d, size, list(gap.shape))
    model.E, model.nu = 1.0, 0.0
    tamaas.ModelFactory.registerNonPeriodic(model, "free")
    solver = tamaas.PolonskyKeerRey(model, -gap / d, 1e-9)
    solver.setIntegralOperator("free")
    solver.max_iter = 3000
    # pressures in units of E* d/a
    solver.solve(load / (spots.e_star * d * a) / (size[0] * size[1]))
    pressure = np.array(model.traction)
    sunk = np.zeros_like(pressure)
    model.operators["free"](pressure, sunk)
    touch = pressure > 0.0
    approach = float(np.mean((sunk + gap / d)[touch])) * d
    return pressure * spots.e_star * d / a, approach


def _relative_changes(spots: Spots, lift: float, loads: Array) -> dict[str, Any]:
    return {"approach": float(lift / spots.overlap.max()), "loads": (loads / spots.load - 1.0).tolist()}


def print_interaction(report: dict[str, Any] | None) -> None:
    """Print the result of `interaction`."""
    if report is None:
        print("elastic interaction of spots: none, no body has two loaded spots on one plate")
        return
    where = (
        f"body {report['body']}, {report['spots']} spots on the {report['plate']} plate, {report['nearest']:.1f} contact "
        f"radii apart"
    )
    print(f"above the finest law, what Hertz and Mindlin neglect: elastic interaction of spots; most in {where}:")
    print(f"  a neighbour's load makes {_percent(report['neighbour_fraction'])} of a spot's overlap, and of s_c when it slides")
    for name, label in (("closed_form", "closed form, far point loads"), ("boundary_elements", "boundary elements, tamaas")):
        result = report[name]
        if result is not None:
            loads = ", ".join(_percent(x, "+") for x in result["loads"])
            print(f"  {label}: approach {_percent(result['approach'], '+')}, loads of the spots {loads}")
    if report["why"]:
        print(f"  {report['why']}")


def _percent(fraction: float, sign: str = "") -> str:
    return f"{100.0 * fraction:{sign}.2g} %"
