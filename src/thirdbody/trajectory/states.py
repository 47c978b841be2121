"""States of the bodies: over the frames, their changes, and those of one frame by population, by material and by size."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from thirdbody.trajectory.names import SIDES
from thirdbody.trajectory.open_file import damage_as_fault
from thirdbody.trajectory.run_arrays import RunArrays
from thirdbody.units import GLUE, percent, with_unit

SIZE_CLASSES, SMALLEST_CLASS = 4, 5
"""Number of size classes, equal in bodies, and the least number of bodies in one."""

ALIKE = 1.02
"""Bodies have one size if the largest diameter is at most this many times the smallest."""

POPULATION, MATERIAL, SIZE = KINDS = ("population", "material", "size")


def code_name(names: Sequence[str], code: int) -> str:
    """Return the name of a code, or the code where it has none."""
    return names[code] if 0 <= code < len(names) else str(code)


def _size_classes(diameter: np.ndarray | None) -> list[tuple[str, str, np.ndarray]]:
    """Return classes of equal number by volume-equivalent diameter, ascending; none where all bodies have one size."""
    if diameter is None or not len(diameter) or diameter.max() <= ALIKE * diameter.min():
        return []
    count = min(SIZE_CLASSES, len(diameter) // SMALLEST_CLASS)
    if count < 2:
        return []
    edges = np.unique(np.quantile(diameter, np.linspace(0.0, 1.0, count + 1)))
    index = np.clip(np.searchsorted(edges, diameter, "right") - 1, 0, len(edges) - 2)
    ends = [with_unit(edge, "m", 2) for edge in edges]
    return [(SIZE, f"{ends[k]} to {ends[k + 1]}", index == k) for k in range(len(edges) - 1) if (index == k).any()]


def states_by_group(run: RunArrays) -> dict[str, list[dict[str, Any]]]:
    """Return per kind of group a list of `name`, `bodies`, `load_share` (of the plate's normal force), `fractions`: at the end.

    `fractions` maps each state to its fraction. Populations also have their `material`, size classes the limits `smallest` and
    `largest` [m]. Empty for a run without labels.
    """
    if not run.frames or not run.has_states:
        return {}
    bodies, result = run.bodies(-1), dict[str, list[dict[str, Any]]]()
    with damage_as_fault(run.path, "bodies and contacts"):
        load = _load_fractions(run, len(bodies["state"]))
        groups: list[tuple[str, str, np.ndarray]] = []  # kind, name, members (B,), bool
        for kind, names in ((POPULATION, run.population_names), (MATERIAL, run.material_names)):
            codes = bodies.get(kind, np.zeros(0, np.int64))
            groups += [(kind, code_name(names, int(code)), codes == code) for code in np.unique(codes)]
        for kind, name, members in groups + _size_classes(bodies.get("diameter")):
            states = bodies["state"][members]
            fractions = np.bincount(states, minlength=len(run.state_names)) / len(states)
            row: dict[str, Any] = {"name": name, "bodies": len(states)}
            if kind == POPULATION and "material" in bodies:
                row["material"] = code_name(run.material_names, int(bodies["material"][members][0]))
            if kind == SIZE:
                sizes = bodies["diameter"][members]
                row |= {"smallest": float(sizes.min()), "largest": float(sizes.max())}
            if load is not None:
                row["load_share"] = float(load[members].sum())
            row["fractions"] = dict(zip(run.state_names, fractions.tolist(), strict=False))
            result.setdefault(kind, []).append(row)
    return result


def _load_fractions(run: RunArrays, count: int) -> np.ndarray | None:
    contacts = run.block("contacts", -1)
    if not {"side", "body", "normal_force"} <= set(contacts):
        return None
    for side in ("upper", "lower"):
        on = contacts["side"] == SIDES.index(side)
        forces = np.bincount(contacts["body"][on], contacts["normal_force"][on], count)
        if forces.sum() > 0.0:
            return np.asarray(forces / forces.sum())
    return None


def informative_groups(result: dict[str, list[dict[str, Any]]]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the informative kinds of groups: of more than one group; materials only where populations share one."""
    for kind in KINDS:
        rows = result.get(kind, [])
        same = kind == MATERIAL and len(rows) == len(result.get(POPULATION, []))
        if len(rows) > 1 and not same:
            yield kind, rows


def fractions_text(fractions: dict[str, float], maximum: int = 4) -> str:
    """Return `95 % rolling, 5 % sliding`, the largest first."""
    portions = sorted(fractions.items(), key=lambda entry: -entry[1])[:maximum]
    return ", ".join(f"{percent(fraction)} {name}" for name, fraction in portions if fraction > 0.0).replace(GLUE, " ")


def state_counts(run: RunArrays) -> dict[str, np.ndarray]:
    """Return the number of bodies of the scene in each state, (F,) each."""
    if run.rows("clumps", 0) == run.scene_bodies:
        return {name: np.count_nonzero(run.states == code, axis=1) for code, name in enumerate(run.state_names)}
    return {name: np.rint(run.series[f"fraction_{name}"] * run.scene_bodies).astype(np.int64) for name in run.state_names}
