"""A small TOML writer: tables for the first two levels, inline tables below."""

import json
import math
import re
from typing import Any

from thirdbody.errors import Fault, InputError, printable
from thirdbody.schema.fields import is_unicode
from thirdbody.schema.parts import Location, key_path

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(document: dict[str, Any]) -> str:
    """Return the document as TOML text. Raises InputError for a value that TOML cannot represent."""
    return "\n".join(_table(document, (), "")) + "\n"


def toml_value_text(value: Any, key: str) -> str:
    """Return one value as TOML text. Raises InputError, which names the key, for one that TOML cannot represent."""
    return _value(value, (key,))


def _table(table: dict[str, Any], location: Location, header: str) -> list[str]:
    """Return header and lines; tables of the first two levels, and lists of tables of the first, get headers of their own."""

    def is_inner(value: Any) -> bool:
        if isinstance(value, list):
            return bool(value) and not location and all(isinstance(entry, dict) for entry in value)
        return isinstance(value, dict) and len(location) < 2

    inner = {key: value for key, value in table.items() if is_inner(value)}
    lines = _assignments({key: value for key, value in table.items() if key not in inner}, location)
    if header and (lines or not inner):
        lines = ["", header, *lines]
    for key, value in inner.items():
        name = f"{header[1:-1]}.{_key(key)}" if header else _key(key)
        if isinstance(value, dict):
            lines += _table(value, (*location, key), f"[{name}]")
        else:
            for i, entry in enumerate(value):
                lines += ["", f"[[{name}]]", *_assignments(entry, (key, i))]
    return lines


def _assignments(table: dict[str, Any], location: Location) -> list[str]:
    return [f"{_key(key)} = {_value(value, (*location, key))}" for key, value in table.items()]


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    # JSON's escapes are TOML's; characters that control a terminal are escaped too: DEL, the codes above it, marks of direction
    if not is_unicode(text):
        raise InputError(f"'{text}' holds bytes that are no letters of UTF-8, and cannot be written to a scene file")
    forms = {4: "\\u{:04x}", 8: "\\U{:08x}"}
    return "".join(
        letter if printable(letter) == letter else forms[4 if ord(letter) < 0x10000 else 8].format(ord(letter))
        for letter in json.dumps(text, ensure_ascii=False)
    )


def _value(value: Any, location: Location) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    if isinstance(value, list):
        return "[" + ", ".join(_value(entry, (*location, i)) for i, entry in enumerate(value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(_assignments(value, location)) + "}"
    raise InputError(Fault(key_path(location), f"{value!r} cannot be written to a scene file"))
