"""Lists of stages for motion and load of the upper plate: each stage is a table with one leading key."""

import difflib
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pydantic import ValidationError, ValidationInfo, ValidatorFunctionWrapHandler, WrapValidator

from thirdbody.scene.field_types import show
from thirdbody.scene.schema_base import MISSING, Part, Wrong, bundle, wrongs_of

Kinds = Mapping[str, type[Part]]


def stages(kinds: Kinds, example: str, endless: Callable[[Any], str | None]) -> WrapValidator:
    """Return a validator of one stage, or of a list of them.

    `kinds`: leading key to table; `endless` names the key that a stage before the last needs to have an end, None if it has one.
    """

    def read(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        entries = list(value) if isinstance(value, list | tuple) else [value]
        if not entries:
            raise ValueError("the list of stages is empty")
        result = []
        faults: list[Wrong] = []
        for k, entry in enumerate(entries):
            location: tuple[str | int, ...] = (k,) if isinstance(value, list | tuple) else ()
            try:
                result.append(table_by_leading_key(entry, info, kinds, example))
            except ValidationError as error:
                faults += [((*location, *where), text) for where, text in wrongs_of(error)]
            except ValueError as error:
                faults.append((location, str(error)))
        for k, stage in enumerate(result[:-1]):
            key = endless(stage)
            if key is not None:
                faults.append(((k, key), f"{MISSING}: only the last stage may go on for ever"))
        if faults:
            raise bundle(faults)
        return tuple(result)

    return WrapValidator(read)


def table_by_leading_key(value: Any, info: ValidationInfo, kinds: Kinds, example: str) -> Any:
    """Return one table, of the kind whose leading key it has. Raises ValueError, or ValidationError with its faults."""
    if isinstance(value, tuple(kinds.values())):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"expected a table such as {example}, got {show(value)}")
    leading = [key for key in kinds if key in value]
    if not leading:
        near = [_nearest_key(key, kinds) for key in value]
        leading = [key for key in near if key is not None]
    if len(leading) != 1:
        raise ValueError(f"give one of {', '.join(kinds)}" + (f", not {' and '.join(leading)}" if leading else ""))
    return kinds[leading[0]].model_validate(value, context=info.context)


def _nearest_key(key: str, kinds: Iterable[str]) -> str | None:
    close = difflib.get_close_matches(key, kinds, 1, 0.6)
    return close[0] if close else None


def plain_stages(result: tuple[Part, ...]) -> Any:
    """Return a single stage as a table, several as a list."""
    report = [stage.model_dump(exclude_none=True) for stage in result]
    return report[0] if len(report) == 1 else report
