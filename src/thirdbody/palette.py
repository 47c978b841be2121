"""Colours of the states and of scalar fields, the same in every picture, plot and viewer script.

The state colours are distinguishable under protanopia, deuteranopia and tritanopia (Tableau 10, the blue, orange and green).
"""

from collections.abc import Sequence
from itertools import cycle

import numpy as np

PAPER, PANEL = "#FFFFFF", "#F5F7F9"
INK, SOFT_INK = "#20242A", "#5A626C"

STATE_COLORS = {"free": "#8E939A", "sticking": "#4C78A8", "sliding": "#F58518", "rolling": "#54A24B"}

# For states added by the labeller of a plug-in.
SPARE_COLORS = ("#B279A2", "#E45756", "#72B7B2", "#EECA3B", "#9D755D")

# For reasons and other codes: the muted scheme of P. Tol, "Colour Schemes" (SRON 2021), made for colour-blind readers; the
# first code means "none" and has its pale grey.
CATEGORY_COLORS = ("#BBBBBB", "#CC6677", "#332288", "#DDCC77", "#117733", "#88CCEE", "#882255", "#44AA99", "#999933", "#AA4499")

# For lines other than states: distinct for every kind of colour vision (M. Okabe, K. Ito, 2008).
LINE_COLORS = {
    "black": "#000000", "orange": "#E69F00", "sky": "#56B4E9", "green": "#009E73", "blue": "#0072B2", "vermilion": "#D55E00",
    "purple": "#CC79A7", "grey": "#6B6F76",
}  # fmt: skip

# Tubes of contact forces, from none to the largest: light and dark violet, which no state has.
FORCE_COLORS = ("#BFAED4", "#2A0A45")

# Viridis (S. van der Walt, N. Smith, 2015) at nine equal steps; linear interpolation differs by at most 2 of 255.
FIELD_STOPS = ("#440154", "#472D7B", "#3B528B", "#2C728E", "#21918C", "#28AE80", "#5EC962", "#ADDC30", "#FDE725")


def rgb(color: str) -> tuple[int, int, int]:
    """Return red, green and blue (0 to 255) of a colour written as `#RRGGBB`."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def state_colors(names: Sequence[str]) -> list[str]:
    """Return one colour `#RRGGBB` per state name; unknown names get spare colours in turn."""
    spare = cycle(SPARE_COLORS)
    return [STATE_COLORS[name] if name in STATE_COLORS else next(spare) for name in names]


def category_colors(count: int) -> list[str]:
    """Return one colour `#RRGGBB` for each of `count` codes; beyond ten they repeat, without the grey."""
    first, others = CATEGORY_COLORS[0], CATEGORY_COLORS[1:]
    return [first, *(others[i % len(others)] for i in range(count - 1))][:count]


def mixed(ends: tuple[str, str], fraction: np.ndarray) -> np.ndarray:
    """Return colours (..., 3) uint8 from the first to the second of two `#RRGGBB`, by fractions (...) from 0 to 1."""
    first, second = (np.array(rgb(color), np.float64) for color in ends)
    return np.rint(first + np.clip(fraction, 0.0, 1.0)[..., None] * (second - first)).astype(np.uint8)


def pale(colors: np.ndarray, white: float) -> np.ndarray:
    """Mix colours (n, 3) uint8 with a fraction of white."""
    return np.rint((1.0 - white) * colors + white * 255.0).astype(np.uint8)


def field_colors(fraction: np.ndarray) -> np.ndarray:
    """Return colours (n, 3) uint8 of values 0 to 1; outside these the end colours, for NaN light grey."""
    stops = np.array([rgb(stop) for stop in FIELD_STOPS], dtype=np.float64)
    known = np.nan_to_num(np.clip(fraction, 0.0, 1.0))
    positions = np.linspace(0.0, 1.0, len(stops))
    colors = np.stack([np.interp(known, positions, stops[:, channel]) for channel in range(3)], axis=-1)
    colors[np.isnan(fraction)] = 215.0
    return np.rint(colors).astype(np.uint8)
