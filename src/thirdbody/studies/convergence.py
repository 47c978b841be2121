"""Order of convergence of a study's errors: with the springs of a law, and with the step of its integrator."""

import math
from typing import Any

from thirdbody.studies.compare import errors, order
from thirdbody.studies.cost import Row, Study, figure_of_merit, percent

FLOOR = 1e-9
"""Smaller errors are rounding and define no order."""

FALLS = 0.7
"""Largest ratio of successive errors that still defines an order: half the step or the springs at order 1/2."""


SLOWEST = 1.0 + math.sqrt(2.0)
"""Least ratio of successive errors for which the error of the reference is extrapolated: order 1/2."""


def convergence(built: Study) -> list[dict[str, Any]]:
    """Return series of errors with their order: `what`, `against`, `sizes` (falling), `errors`, `order` (None if unknown).

    Springs are compared with the finest law at the same step, steps with the shortest step and the same law: each with the limit
    to which it converges, which is not the reference of the study, finer in both.
    """
    return [*_of_springs(built), *_of_steps(built)]


def _of_springs(built: Study) -> list[dict[str, Any]]:
    laws = [row for row in built.rows if row.variant.axis == "law" and row.stable]
    rows = [row for row in laws if row.variant.springs is not None]
    if not rows:
        return []
    finest = laws[-1]
    if finest in rows:  # no law without springs: the largest number of springs is the reference
        rows.remove(finest)
    sizes = [1.0 / row.variant.springs for row in rows]  # type: ignore[operator]
    return [_series(built, "springs", [str(row.variant.springs) for row in rows], sizes, rows, finest)]


def _of_steps(built: Study) -> list[dict[str, Any]]:
    result = []
    laws = [row for row in built.rows if row.variant.axis == "law"]
    extra = {"step": built.default, "fine": laws[-1] if laws else None}
    for what, axis in (("step", "step"), ("other integrator's step", "integrator"), ("step of the finest law", "fine")):
        rows = [row for row in built.rows if row.variant.axis == axis]
        rows += [row for row in (extra.get(axis), built.reference if axis == "fine" else None) if row is not None]
        rows = sorted((row for row in rows if row.stable and row.step), key=lambda row: -float(row.step or 0.0))
        if len({row.integrator for row in rows}) != 1 or len(rows) < 3:
            continue
        explicit = rows[0].integrator == "explicit"
        unit = " s" if explicit else ""
        names = [f"{row.step:.2g}{unit}" for row in rows[:-1]]
        sizes = [_size(row) for row in rows[:-1]]
        result.append(_series(built, f"{what} ({'time step' if explicit else 'tolerance'})", names, sizes, rows[:-1], rows[-1]))
    return result


def _size(row: Row) -> float:
    """Return the step length of a variant; an implicit one goes as the square root of its error tolerance."""
    return float(row.step or 0.0) ** (1.0 if row.integrator == "explicit" else 0.5)


def _series(built: Study, what: str, names: list[str], sizes: list[float], rows: list[Row], limit: Row) -> dict[str, Any]:
    merit = figure_of_merit(built)
    assert limit.outcome is not None
    result = [errors(row.outcome, limit.outcome)[merit] if row.outcome is not None else math.nan for row in rows]
    fitted = falling(result)
    slope = order(sizes[:fitted], [e if e > _floor(built) else math.nan for e in result[:fitted]])
    return {"what": what, "against": limit.variant.name, "sizes": names, "errors": result, "order": slope, "fitted": fitted}


def _floor(built: Study) -> float:
    """Return the largest error that defines no order: rounding, which grows where bodies meet."""
    return max(FLOOR, built.scatter.get(figure_of_merit(built), 0.0))


def falling(result: list[float]) -> int:
    """Return the number of errors from the first on that define an order.

    All before the first that is more than `FALLS` times its predecessor, where another error dominates; all where that leaves
    only one.
    """
    for k in range(1, len(result)):
        if not result[k] <= FALLS * result[k - 1]:
            return k if k > 1 else len(result)
    return len(result)


def reference_error(built: Study) -> float:
    """Return the estimated relative error of the reference itself; NaN when its steps do not allow an estimate.

    Errors C h^p against a limit of step h_L, of steps r h_L and r^2 h_L, are C h_L^p times (r^p - 1) and (r^2p - 1): their ratio
    is r^p + 1, and the error at h_L is the first one over r^p - 1 (L.F. Richardson, Phil. Trans. A 210, 1911).
    """
    merit, last = figure_of_merit(built), built.reference
    rows = [row for row in built.rows if row.stable and row.integrator == last.integrator and row.step
            and (row.variant.level, row.variant.springs) == (last.variant.level,
                 last.variant.springs) and row is not last]  # fmt: skip
    sizes = {_size(row) / _size(last): row.errors[merit] for row in rows}
    r = min((size for size in sizes if size > 1.0), default=math.nan)
    second = next((error for size, error in sizes.items() if math.isclose(size, r * r, rel_tol=0.01)), math.nan)
    first = sizes.get(r, math.nan)
    growth = second / first if first > _floor(built) else math.nan
    return first / (growth - 2.0) if growth > SLOWEST else math.nan


def print_reference(built: Study) -> None:
    """Print the estimated error of the reference."""
    report = reference_error(built)
    words = (
        "not known, its steps show no order" if math.isnan(report) else f"about {percent(report)}, extrapolated from its steps"
    )
    print(f"error of the reference itself: {words}; smaller differences are not significant")


def print_convergence(series: list[dict[str, Any]]) -> None:
    """Print each series on a line."""
    for entry in series:
        values = ", ".join(f"{name}: {percent(error)}" for name, error in zip(entry["sizes"], entry["errors"], strict=True))
        slope = "not known" if math.isnan(entry["order"]) else f"{entry['order']:.2f}"
        first = f" of the first {entry['fitted']}" if entry["fitted"] < len(entry["sizes"]) else ""
        print(f"convergence with the {entry['what']} against {entry['against']}: {values}; order{first} {slope}")
