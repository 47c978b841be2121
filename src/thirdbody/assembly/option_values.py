"""Values of the options of laws, effects and measures that a scene gives, in SI, and the faults of what it gives."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from thirdbody import units
from thirdbody.errors import Fault, nearest
from thirdbody.laws.contract import PAIR_KEYS, BodyEffect, Law, Option, SpotInteraction
from thirdbody.laws.measures import Measure
from thirdbody.scene.model import Scene
from thirdbody.schema.fields import as_float, show

Effect = Law | BodyEffect | SpotInteraction


def effect_values(
    scene: Scene, effect: Law | BodyEffect | SpotInteraction | Measure, given: Any, location: tuple[str, ...], faults: list[Fault]
) -> dict[str, Any]:
    """Return the option values of an effect, given as a table, its only value, or `true`."""
    names = [option.name for option in effect.options]
    if not isinstance(given, Mapping):
        if len(names) != 1 and given is not True:
            what = f"a table with {', '.join(names)}" if names else "true, or leave it out: it has no options"
            faults.append(scene.fault(location, f"expected {what}"))
            return {}
        given = {names[0]: given} if len(names) == 1 else {}
    unknown = [key for key in given if key not in names]
    for key in unknown:
        hint = nearest(key, names) or "it has none"
        faults.append(scene.fault((*location, key), f"unknown key, {hint}"))
    # a misspelt option is not also reported as missing
    options = [option for option in effect.options if not unknown or option.name in given]
    return option_values(scene, options, given, location, faults)


def option_values(
    scene: Scene, options: Sequence[Option], given: Mapping[str, Any], location: tuple[str, ...], faults: list[Fault]
) -> dict[str, Any]:
    """Return the values of options in SI, without those that only pairs give; faults go to `faults`."""
    values: dict[str, Any] = {}
    for option in options:
        raw = given.get(option.name, option.default)
        if raw is None:
            faults += _missing(scene, option, location)
            continue
        try:
            values[option.name] = option_value(option, raw, option.name in given)
        except ValueError as problem:
            faults.append(scene.fault((*location, option.name), str(problem)))
    return values


def option_value(option: Option, raw: Any, given: bool) -> float | str | tuple[float, ...]:
    """Return the value of an option in SI. Raises ValueError where it is not allowed."""
    if option.words:
        if raw in option.words:
            return raw
        if not option.or_number or isinstance(raw, str):
            also = f" or a number from {option.low:g} to {option.high:g}" if option.or_number else ""
            raise ValueError(f"expected {' or '.join(repr(word) for word in option.words)}{also}, got {show(raw)}")
    if option.size == 1:
        return _number(option, raw, given)
    if not isinstance(raw, list | tuple) or len(raw) != option.size:
        raise ValueError(f"expected a list of {option.size} values")
    return tuple(_number(option, x, given) for x in raw)


def _number(option: Option, raw: Any, given: bool) -> float:
    """Return a number of the option's dimension in SI. A bare number is accepted if dimensionless, or as a default."""
    if isinstance(raw, str):
        value = units.parse(raw, option.dimension)
    elif isinstance(raw, bool) or not isinstance(raw, int | float):
        raise ValueError(f"expected a number or a text with a unit, got {show(raw)}")
    elif given and option.dimension != "dimensionless":
        value = units.parse(str(as_float(raw)), option.dimension)
    else:
        value = as_float(raw)
    if not option.low <= value <= option.high:
        raise ValueError(f"{show(raw).strip(chr(39))} must {_range(option)}")
    units.refuse_absurd(value, option.dimension, show(raw))
    return value


def _range(option: Option) -> str:
    unit = "" if option.dimension == "dimensionless" else f" (SI, {option.dimension})"
    if math.isinf(option.high):
        return f"be at least {option.low:g}{unit}"
    if math.isinf(option.low):
        return f"be at most {option.high:g}{unit}"
    return f"lie between {option.low:g} and {option.high:g}{unit}"


def _missing(scene: Scene, option: Option, location: tuple[str, ...]) -> list[Fault]:
    message = f"required key '{option.name}' is missing"
    if option.pair_key:
        lacking = ["/".join(pair.between) for pair in scene.pairs if getattr(pair, option.pair_key) is None]
        if scene.pairs and not lacking:
            return []
        if len(lacking) < len(scene.pairs):
            message += f", and {', '.join(lacking)} of [[pairs]] give no {option.pair_key} of their own"
    return [scene.fault(location, f"{message}: {option.doc}")]


def pair_value_faults(scene: Scene, effects: Mapping[str, Effect]) -> list[Fault]:
    """Return faults of values of pairs that no effect of the scene takes: they would be silently ignored.

    `effects`: all that are installed, by name.
    """
    faults = []
    for key in PAIR_KEYS:
        owners = {name: option.name for name, effect in effects.items() for option in effect.options if option.pair_key == key}
        if owners.keys() & scene.effects.named.keys():
            continue
        tables = " or ".join(f"{name} = {{{option} = ...}}" for name, option in owners.items())
        hint = f": add [effects] {tables}" if tables else ""
        given = [k for k, pair in enumerate(scene.pairs) if getattr(pair, key) is not None]
        faults += [scene.fault(("pairs", k, key), f"the effect that it belongs to is off{hint}") for k in given]
    return faults
