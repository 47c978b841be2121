"""One oblique impact at every level of a law, compared with the closed form of gross slip and its own converged result.

A sphere of aluminium oxide at 3.9 m/s on a plane a million times as stiff: test 4 of Y.C. Chung and J.Y. Ooi, Granular Matter 13
(2011) 643. At 60 degrees the contact slips all the time, and friction's impulse is mu times the normal one for any law; at 15
degrees part of it sticks, and the laws differ.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from thirdbody.scene.model import Scene
from thirdbody.studies.compare import order
from thirdbody.studies.cost import Study, percent
from thirdbody.studies.variants import SPRINGS, springs_option

RADIUS, SPEED, FRICTION, RESTITUTION = 2.5e-3, 3.9, 0.092, 0.98
STEEP, SHALLOW = 60.0, 15.0
STEPS = (50, 100, 200, 400)
"""Time steps in the duration of the impact."""
FINE = 1600
"""The same of the reference."""

SCENE = """
scene = 1
title = "an oblique impact"
[materials.ball]
youngs_modulus = "380 GPa"
poisson_ratio = 0.23
density = "4000 kg/m3"
[materials.plane]
youngs_modulus = "380e6 GPa"
poisson_ratio = 0.23
density = "4000 kg/m3"
[[pairs]]
between = ["ball", "plane"]
friction = 0.092
restitution = 0.98
[[pairs]]
between = ["ball", "ball"]
friction = 0.092
restitution = 0.98
[[debris]]
material = "ball"
kind = "spheres"
radius = "2.5 mm"
positions = [["5 m", "5 m", "2.5 mm"]]
[domain]
size = ["10 m", "10 m"]
[plates.lower]
material = "plane"
[contact]
law = "hertz_mindlin"
level = "mindlin"
[solver]
integrator = "explicit"
duration = "1 s"
[output]
every = "1 s"
"""


def duration() -> float:
    """Return the duration of the undamped impact [s], the shorter of the two angles (Hertz: 2.943 delta/v, v normal)."""
    return 2.94328 * _max_overlap(SPEED * math.cos(math.radians(SHALLOW))) / (SPEED * math.cos(math.radians(SHALLOW)))


def _max_overlap(normal: float) -> float:
    """Return the largest overlap of a Hertz impact [m]: (15 m v^2/(16 E* R^(1/2)))^(2/5)."""
    mass, e_star = 4000.0 * 4.0 / 3.0 * math.pi * RADIUS**3, 380e9 / (1.0 - 0.23**2)
    return float((15.0 * mass * normal**2 / (16.0 * e_star * math.sqrt(RADIUS))) ** 0.4)


def rebound(law: str, level: str, springs: int | None, degrees: float, steps: int, plugins: Sequence[str | Path]) -> float:
    """Return the tangential velocity of the centre after the impact over that before; `steps` time steps in its duration."""
    from thirdbody.runner.prepare import prepare

    angle, step = math.radians(degrees), duration() / steps
    along, normal = SPEED * math.sin(angle), SPEED * math.cos(angle)
    built = prepare(Scene.parse(SCENE).with_settings({
        "contact.law": law, "contact.level": level, **({} if springs is None else {"contact.springs": springs}),
        "solver.time_step": f"{step!r} s",
        "debris.0.velocity": [f"{along!r} m/s", "0 m/s", f"{-normal!r} m/s"],
    }), plugins)  # fmt: skip
    built.integrator.advance_to(3.0 * duration() * (math.cos(math.radians(SHALLOW)) / math.cos(angle)) ** 0.2)
    return float(built.state.bodies.velocity[0, 0]) / along


def gross_slip(degrees: float) -> float:
    """Return the same where the contact slips throughout: 1 - mu (1 + e)/tan(angle).

    Coulomb's law on impulses: that of friction is mu times the normal one, (1 + e) m v_n (Maw, Barber and Fawcett 1976, gross
    slip).
    """
    return 1.0 - FRICTION * (1.0 + RESTITUTION) / math.tan(math.radians(degrees))


def impact_table(built: Study, plugins: Sequence[str | Path]) -> dict[str, Any]:
    """Return the errors of the tangential impulse at both angles, by level and springs, and by time step at the finest level."""
    from thirdbody.laws.registry import discover

    law = Scene.load(built.scene, plugins).contact.law
    family = discover(tuple(plugins)).families[law]
    finest = list(family.levels)[-1]
    result: dict[str, Any] = {"law": law, "reference": f"{finest}, {FINE} steps", "levels": [], "springs": None, "steps": None}
    true = rebound(law, finest, springs_option(family, finest), SHALLOW, FINE, plugins)
    same = rebound(law, finest, springs_option(family, finest), SHALLOW, STEPS[-1], plugins)
    rows: list[dict[str, Any]] = []
    for level in family.levels:
        option = springs_option(family, level)
        for springs in (None,) if option is None else SPRINGS:
            steep, shallow = (rebound(law, level, springs, degrees, STEPS[-1], plugins) for degrees in (STEEP, SHALLOW))
            rows.append({
                "level": level, "springs": springs, "gross_slip_error": _impulse_error(steep, gross_slip(STEEP)),
                "partial_slip_error": _impulse_error(shallow, true), "_springs_error": _impulse_error(shallow, same),
            })  # fmt: skip
    sprung = [(row["springs"], row.pop("_springs_error")) for row in rows]
    sprung = [(n, error) for n, error in sprung if n is not None]
    result["levels"] = rows
    if sprung:
        result["springs"] = _series([n for n, _ in sprung], [error for _, error in sprung])
    stepped = [rebound(law, finest, springs_option(family, finest), SHALLOW, n, plugins) for n in STEPS]
    result["steps"] = _series(list(STEPS), [_impulse_error(x, true) for x in stepped])
    return result


def _impulse_error(ratio: float, true: float) -> float:
    return abs(ratio - true) / abs(1.0 - true)


def _series(sizes: list[int], errors: list[float]) -> dict[str, Any]:
    return {"sizes": sizes, "errors": errors, "order": order([1.0 / n for n in sizes], errors)}


def print_impact(message: dict[str, Any]) -> None:
    """Print the result of `impact_table`."""
    from thirdbody.report.tables import table

    rows = [
        (row["level"], str(row["springs"] or ""), percent(row["gross_slip_error"]), percent(row["partial_slip_error"]))
        for row in message["levels"]
    ]
    title = f"an oblique impact: error of friction's impulse with {STEPS[-1]} steps"
    table(title, ("level", "springs", f"{STEEP:g} degrees, closed form", f"{SHALLOW:g} degrees, {message['reference']}"), rows)
    for name in ("springs", "steps"):
        series = message[name]
        if series:
            values = ", ".join(f"{n}: {percent(e)}" for n, e in zip(series["sizes"], series["errors"], strict=True))
            print(f"convergence with the {name} at {SHALLOW:g} degrees: {values}; order {series['order']:.2f}")
