"""Particles of the regime map, computed with full partial slip: their states when pressed and dragged."""

from .balance import Result, balance
from .regime_map import MapPoint

HEIGHT, RADIUS, CLOSING = 4.0, 2.0, 0.01
"""[um]; the indentation is small against all lengths, as the theory assumes."""

POSITIONS = (-1.0, -0.75, -0.4, -0.1, 0.15, 0.4, 0.7, 0.95, 1.25)
FRICTIONS = (0.12, 0.35, 0.6, 0.85)
STEPS = 60


def computed_points(half_width: float) -> tuple[MapPoint, ...]:
    """Points for the panel of regimes, x_1/h over friction; lower spots at -+ `half_width` (over h).

    Undecided ones are omitted.
    """
    result = [(x, mu, _regime(_dragged(x, half_width, mu))) for x in POSITIONS for mu in FRICTIONS]
    return tuple(MapPoint("regimes", x, mu, state) for x, mu, state in result if state is not None)


def _dragged(x_1: float, half_width: float, mu: float) -> Result:
    """Return the particle of the map under a load, dragged well beyond the critical displacement of its spots."""
    solid = {"shear_modulus": "80 GPa", "poisson_ratio": 0.3}
    spots = [
        {"side": "upper", "x": f"{x_1 * HEIGHT} um", "z": f"{0.5 * HEIGHT} um", "radius": f"{RADIUS} um"},
        *(
            {"side": "lower", "x": f"{x * HEIGHT} um", "z": f"{-0.5 * HEIGHT} um", "radius": f"{RADIUS} um"}
            for x in (-half_width, half_width)
        ),
    ]
    return balance(
        {
            "balance": 1,
            "materials": {"upper": solid, "lower": solid, "particle": solid},
            "friction": {"upper": mu, "lower": mu},
            "particle": {"weight": "0 N", "spots": spots},
            "path": {"load": "0.1 mN", "drag": f"{60.0 * mu} nm", "steps": STEPS},
        }
    )


def _regime(result: Result) -> str | None:
    """Rolling if it is not held even at rest, sliding if it ends so, sticking if it tips during the drag; None if undecided.

    It tips when a spot lifts off: from then on two spots carry it.
    """
    if result.stopped is not None and result.stopped.label != "rolling":
        return None
    if not result.points or result.points[0].label == "rolling":
        return "rolling"
    last = result.points[-1]
    if result.stopped is None and last.label == "sliding":
        return "sliding"
    return "sticking" if result.stopped is not None or last.label == "rolling" or "open" in last.spots else None
