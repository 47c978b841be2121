"""A small TOML writer for scene documents: tables for the first two levels, inline tables below."""

import json
import math
import os
import re
from typing import Any

from thirdbody.errors import Fault, InputError, OutputError, printable
from thirdbody.schema.fields import is_unicode
from thirdbody.schema.parts import Location, key_path

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(document: dict[str, Any]) -> str:
    """Return the document as TOML text. Raises InputError for a value that TOML cannot represent."""
    lines = [f"{_key(name)} = {_value(v, (name,))}" for name, v in document.items() if not _is_section(v)]
    for name, value in document.items():
        if isinstance(value, dict):
            lines += _table(value, (name,), f"[{_key(name)}]")
        elif _is_section(value):
            for i, entry in enumerate(value):
                lines += ["", f"[[{_key(name)}]]"]
                lines += [f"{_key(key)} = {_value(v, (name, i, key))}" for key, v in entry.items()]
    return "\n".join(lines) + "\n"


def toml_value_text(value: Any, key: str) -> str:
    """Return one value as TOML text. Raises InputError, which names the key, for one that TOML cannot represent."""
    return _value(value, (key,))


def save_text(path: str | os.PathLike[str], text: str) -> None:
    """Write the text as UTF-8. Raises OutputError, or InputError for text that UTF-8 cannot encode."""
    try:
        data = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise InputError(f"the scene holds a character that UTF-8 has no form for: {error.reason}") from None
    try:
        with open(path, "wb") as file:
            file.write(data)
    except OSError as error:
        raise OutputError(f"{os.fspath(path)}: cannot be written: {error.strerror}") from None


def _is_section(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)
    )


def _table(table: dict[str, Any], location: Location, header: str) -> list[str]:
    """Return header and lines; inner tables get headers of their own at the second level."""
    nested = {key: value for key, value in table.items() if isinstance(value, dict) and len(location) < 2}
    lines = [f"{_key(key)} = {_value(v, (*location, key))}" for key, v in table.items() if key not in nested]
    lines = ["", header, *lines] if lines or not nested else []
    for key, value in nested.items():
        lines += _table(value, (*location, key), f"{header[:-1]}.{_key(key)}]")
    return lines


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    # JSON's escapes are TOML's; characters that control a terminal are escaped too: DEL, the codes above it, marks of direction
    if not is_unicode(text):
        raise InputError(f"'{text}' holds bytes that are no letters of UTF-8, and cannot be written to a scene file")
    quoted = json.dumps(text, ensure_ascii=False)
    return quoted if printable(quoted) == quoted else "".join(map(_escape, quoted))


def _escape(letter: str) -> str:
    if printable(letter) == letter:
        return letter
    return f"\\u{ord(letter):04x}" if ord(letter) < 0x10000 else f"\\U{ord(letter):08x}"


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
        inside = ", ".join(f"{_key(key)} = {_value(entry, (*location, key))}" for key, entry in value.items())
        return "{" + inside + "}"
    raise InputError(Fault(key_path(location), f"{value!r} cannot be written to a scene file"))
