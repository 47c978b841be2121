"""Conformance tests of an interaction of spots (`contract.SpotInteraction`): its two numbers fit Hertz' contact and a half-space.

What is solved with them is the engine's (`kernels.spot_loads`), and conservative for any numbers that pass. In plain Python.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from thirdbody.laws.conformance.paths import PAIRS, option_sets, plain
from thirdbody.laws.conformance.suite import Finding, finding
from thirdbody.laws.contract import SpotInteraction
from thirdbody.laws.data import Contact
from thirdbody.laws.hertz import HERTZ

Result = tuple[bool, str]
Options = dict[str, Any]

ROUND_OFF = 1e-12

OVERLAP = 1e-4
"""Over the radius, of the contact in which forces are compared."""


def declaration(effect: SpotInteraction) -> Result:
    """Its name can be a key, and it has a source."""
    if not effect.name.isidentifier():
        return False, f"name '{effect.name}' is not an identifier"
    return bool(effect.source.strip()), "" if effect.source.strip() else "names no source"


def parameters(effect: SpotInteraction, options: Options) -> Result:
    """Both numbers are finite, the stiffness is positive, the compliance not negative, for all materials."""
    for label, pair, _ in PAIRS:
        values = {"stiffness": effect.stiffness(pair, options)}
        values |= {f"compliance of {one.name}": effect.compliance(one, options) for one in (pair.a, pair.b)}
        for name, value in values.items():
            if not math.isfinite(value) or value < 0.0 or (name == "stiffness" and value == 0.0):
                return False, f"{label}: {name} is {value!r}"
    return True, ""


def stiffness(effect: SpotInteraction, options: Options) -> Result:
    """The force of a spot alone, stiffness (R d^3)^(1/2), is that of Hertz' law, which then sees what is left of the overlap."""
    worst = 0.0
    for label, pair, radius in PAIRS:
        d = OVERLAP * radius
        contact = Contact(d, radius, 8e3 * radius**3, *(0.0,) * 7)
        force = plain(HERTZ.kernel)(contact, HERTZ.mix(pair, {})).force
        off = abs(effect.stiffness(pair, options) * math.sqrt(radius * d**3) / force - 1.0)
        if off > ROUND_OFF:
            return False, f"{label}: the force of a spot alone is off that of Hertz by {off:.1e}"
        worst = max(worst, off)
    return True, f"{worst:.0e}"


def compliance(effect: SpotInteraction, options: Options) -> Result:
    """Both plates of a pair together give way at most as half-spaces do, c_a + c_b <= 1/(pi E*).

    More, and spots that touch could relieve each other by more than their own indentation.
    """
    largest = 0.0
    for label, pair, _ in PAIRS:
        e_star = 0.75 * effect.stiffness(pair, options)
        ratio = math.pi * e_star * sum(effect.compliance(one, options) for one in (pair.a, pair.b))
        if ratio > 1.0 + ROUND_OFF:
            return False, f"{label}: the plates give way {ratio:.3g} times as far as half-spaces"
        largest = max(largest, ratio)
    return True, f"{largest:.3g} of half-spaces"


TESTS: tuple[tuple[str, Callable[[SpotInteraction, Options], Result]], ...] = (
    ("parameters", parameters),
    ("stiffness", stiffness),
    ("compliance", compliance),
)


def check_spots(effect: SpotInteraction) -> list[Finding]:
    """Return all findings on an interaction, with its usual options and those at their ends. What raises fails the test."""
    result = [finding(effect.name, "declaration", partial(declaration, effect))]
    for label, options in option_sets(effect):
        result += [finding(effect.name, f"{name}{label}", partial(test, effect, options)) for name, test in TESTS]
    return result
