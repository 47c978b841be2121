"""Scenes spoilt at random: in their text, or value by value; and what every rejection of one must say."""

import copy
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

from thirdbody.errors import Fault
from thirdbody.schema.write import toml_text

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted(path for path in (ROOT / "scenes").glob("*.toml"))
# few bodies: the oracle is about faults, and a sound scene should be built in a hundredth of a second
SMALL = {name: (36, ["30 um", "30 um"]) for name in ("dense_layer", "angular_bed")} | {
    "scanned_debris": (3, ["40 um", "30 um"]), "million": (36, ["150 um", "120 um"]), "sticky_submicron": (36, ["1 um", "1 um"]),
}  # fmt: skip
LONG = "x" * 100_000
DEEP, DEEP_LIST = {}, []  # type: ignore[var-annotated]
for _ in range(60):
    DEEP, DEEP_LIST = {"a": DEEP}, [DEEP_LIST]

# in no place of a scene but a title or a name can these be right
NEVER: tuple[Any, ...] = (
    float("nan"), float("inf"), float("-inf"), [], "", " ", "nan um", "inf s", "1e300 furlong", LONG, "\x00", "\x1b[2Jgone",
    "\u202e um", "um 5", "1,5 um", "1e999 um", "1e-999 s", DEEP, DEEP_LIST, [[]], [{}], -(10**30), -1, "-1 parsec", "5 um um",
    "1 m9", "1 um^99999999999999999999", "(" * 90 + "um", "NaN", "0x10 um", "\uff15 um!", "__import__('os').system('true')",
    "${HOME}", "$(touch gone)", "!!python/object:os.system", "file:///etc/passwd", "https://example.org/x.csv", "/dev/zero",
    "/dev/stdin", "..", "../..", "/", ".", "~", "a\nb", "a\rb",
)  # fmt: skip
# right in some places
SOMETIMES: tuple[Any, ...] = (
    0, 1, 2, 0.0, -0.0, 0.5, 1e300, -1e300, 5e-324, 10**12, 2**63, 2**64, 10**30, 10**4000, 1e12, True, False, {}, "0 um",
    "1e300 m", "1e-300 m", "1e12 m", "1 m", "5 um", "-5 um", "1 s", "1e-300 s", "1e300 s", "1 N", "1e300 N", "1e-300 N", "1 Pa",
    "1e300 Pa", "1e-300 Pa", "1e300 kg/m3", "1e-300 kg/m3", "1 m/s", "1e300 m/s", "1e-300 m/s", "1e300 kg/s", "1e300 m/s2",
    "1e30 Hz", "1e-30 Hz", "1e300 kg", "1e-300 kg", "1e300 kg m2", "1e300 N/m", "1e-300 N/m", "steel", "auto", "none",
    "implicit", "explicit", "dense", "dilute", "layer", "foundation", "rigid", "spots", "file", "irregular", [1, 2, 3], [0, 0],
    ["1 um", "1 um"], ["1e300 m", "1 m"], [1e300, 1e300, 1e300], [10**12, 10**12],
)  # fmt: skip
HOSTILE_FILES = (
    "/dev/zero", "/dev/random", "/dev/null", "/dev/stdin", "/proc/self/mem", "/etc/passwd", "../../../../../../etc/passwd",
    "fifo", "fifo.stl", "fifo.csv", "fifo.npz", ".", "..", "/", "loop.csv", "https://example.org/a.stl", "file:///etc/passwd",
    "a\x00b.csv", "x" * 5000 + ".csv", "endless.csv", "endless.stl", "endless.npz", "empty.csv", "zero.stl", "no\udce9.csv", "",
    " ", "~/x.csv",
)  # fmt: skip
JUNK = (b"\x00", b"\xff\xfe", b'"', b"'", b'"""', b"[[", b"]]", b"{", b"=", b"\\u0000", b"\\", b"\r", b"#", b"\xc2")
NESTED = ("x = " + "[" * 3000 + "]" * 3000, "x = " + "{a=" * 900 + "1" + "}" * 900, "x = " + "[" * 60 + "]" * 60)
NUMBERS = ("1" * 5000, "0x" + "f" * 40_000, "1e99999", "-" + "9" * 400, "1_000_000_000_000", "+nan", "1979-05-27", "07:32:00")
WORDS = ("0", "x", "-1", "10" * 9, "9" * 5000, "\u0663", "\u00b2", "__class__", "", " ")
FREE = {"title", "name"}


def small(path: Path) -> dict[str, Any]:
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    count, size = SMALL.get(path.stem, (3, document["domain"]["size"]))
    for debris in document["debris"]:
        if "count" in debris:
            debris["count"] = count
        if "file" in debris:
            debris["file"] = str(path.parent / debris["file"])
            debris["spheres"] = 4
    document["domain"]["size"] = list(size)
    pressure = document.get("plates", {}).get("upper", {}).get("pressure")
    if isinstance(pressure, dict):  # of a contact with an edge: few bodies carry their part of the load
        pressure["debris_fraction"] *= 0.005
    return document


def places(node: Any, above: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    entries: Any = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in entries:
        yield (*above, key)
        yield from places(value, (*above, key))


def entry(node: Any, place: tuple[str | int, ...]) -> Any:
    for key in place:
        node = node[key]
    return node


def misspelt(word: str, rng: Random) -> str:
    at = rng.randrange(len(word))
    less, more = word[:at] + word[at + 1 :], word[:at] + "q" + word[at:]
    other = word[:at] + ("z" if word[at] != "z" else "s") + word[at + 1 :]
    return rng.choice((less, more, other, word + "\x1b[1m"))


def spoilt_value(rng: Random) -> tuple[Any, bool]:
    if rng.random() < 0.5:
        return copy.deepcopy(rng.choice(NEVER)), True
    return copy.deepcopy(rng.choice(SOMETIMES)), False


def tame(value: Any, rng: Random) -> Any:
    """The value, if it begins with a number, up to a half larger or smaller: mostly as sound as before."""
    factor = rng.uniform(0.7, 1.5)
    if isinstance(value, float):
        return value * factor
    if isinstance(value, int) and not isinstance(value, bool):
        return max(1, int(value * factor))
    match = re.match(r"-?[\d.]+(?:e-?\d+)?", value) if isinstance(value, str) else None
    return f"{float(match[0]) * factor:.6g}{value[match.end() :]}" if match else value


def spoil(document: dict[str, Any], rng: Random) -> bool:
    known = list(places(document))
    if not known:
        return False
    place = rng.choice(known)
    above, last = entry(document, place[:-1]), place[-1]
    kind = rng.choice(("replace", "replace", "replace", "delete", "misspell", "swap", "add", "again", "file", "kind", "tame"))
    free = bool(FREE & set(map(str, place)))
    if kind == "tame":
        above[last] = tame(above[last], rng)
    elif kind == "replace":
        above[last], must = spoilt_value(rng)
        return must and not free
    if kind == "delete":
        del above[last]
    elif kind == "misspell" and isinstance(above, dict) and isinstance(last, str) and last:
        above[misspelt(last, rng)] = above.pop(last)
        return not (place[0] == "materials" and len(place) == 2)
    elif kind == "swap":
        other = rng.choice(known)
        one, two = entry(document, other[:-1]), entry(document, place)
        if other[: len(place)] != place and place[: len(other)] != other:
            above[last], one[other[-1]] = one[other[-1]], two
    elif kind == "add":
        where = rng.choice([(), *(p for p in known if isinstance(entry(document, p), dict))])
        value, _ = spoilt_value(rng)
        entry(document, where)[rng.choice(("exec", "__class__", "file", "count", "height", "x", "", "a.b", "\x00", "é"))] = value
    elif kind == "again" and isinstance(above, list):
        above[:] = [copy.deepcopy(one) for _ in range(rng.choice((2, 3, 40))) for one in above]
    elif kind == "file":
        which = rng.choice(("mesh", "file", "motion", "loading"))
        name = rng.choice(HOSTILE_FILES).replace("\udce9", "\u00e9")
        if which in ("mesh", "file"):
            document["debris"] = [{"kind": which, "material": "steel", "file": name}]
            if which == "mesh":
                document["debris"][0] |= {"unit": "1 um", "count": 2}
        else:
            plates = document.setdefault("plates", {})
            upper = plates.setdefault("upper", {}) if isinstance(plates, dict) else {}
            if isinstance(upper, dict):
                upper[which] = {"x": {"table": name}} if which == "motion" else {"table": name}
        return True
    elif kind == "kind":
        other = tomllib.loads(rng.choice(SCENES).read_text(encoding="utf-8"))
        key = rng.choice(list(other))
        document[key] = other[key]
        for debris in document["debris"] if key == "debris" else ():
            debris["count"] = 2
    return False


def spoilt_text(text: str, rng: Random) -> bytes:
    kind = rng.choice(("flip", "drop", "double", "cut", "quote", "bracket", "insert", "swap", "bom", "crlf", "deep", "number"))
    data, lines = bytearray(text.encode()), text.split("\n")
    at, line = rng.randrange(len(data)), rng.randrange(len(lines))
    if kind == "flip":
        for _ in range(rng.choice((1, 1, 3, 30))):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        return bytes(data)
    if kind == "cut":
        return bytes(data[:at])
    if kind == "insert":
        return bytes(data[:at] + rng.choice(JUNK) + data[at:])
    if kind == "bom":
        return rng.choice((b"\xef\xbb\xbf" + data, text.encode("utf-16"), text.encode("utf-32")))
    if kind == "drop":
        del lines[line]
    elif kind == "double":
        lines.insert(rng.randrange(len(lines)), lines[line])
    elif kind == "swap":
        other = rng.randrange(len(lines))
        lines[line], lines[other] = lines[other], lines[line]
    elif kind == "quote":
        lines[line] = lines[line].replace('"', rng.choice(("", "'", '"""')), 1)
    elif kind == "bracket":
        lines[line] = re.sub(r"[\[\]{}=,]", "", lines[line], count=1)
    elif kind == "deep":
        lines.insert(line, rng.choice(NESTED))
    elif kind == "number":
        huge = rng.choice(NUMBERS)
        lines[line] = re.sub(r"=.*", lambda _: f"= {huge}", lines[line])
    joined = "\n".join(lines)
    return (joined.replace("\n", "\r\n") if kind == "crlf" else joined).encode()


def mutant(rng: Random) -> tuple[bytes, bool]:
    document = small(rng.choice(SCENES))
    if rng.random() < 0.35:
        return spoilt_text(toml_text(document), rng), False
    must = spoil(document, rng)
    for _ in range(rng.choice((0, 0, 0, 1, 3))):
        spoil(document, rng)
        must = False  # one change may take back another
    return toml_text(document).encode("utf-8", "surrogatepass"), must


def setting(document: dict[str, Any], rng: Random) -> tuple[str, str]:
    """A key of the document, as `--set` takes it and perhaps misspelt, and a value as text."""
    words = [str(part) for part in rng.choice(list(places(document)))]
    if rng.random() < 0.4:
        return ".".join(words), str(tame(entry(document, tuple(int(w) if w.isdecimal() else w for w in words)), rng))
    if rng.random() < 0.2:
        words.insert(rng.randrange(len(words) + 1), rng.choice(WORDS))
    if rng.random() < 0.1:
        words = words[:1] * rng.choice((1, 2, 3000))
    value, _ = spoilt_value(rng)
    if not isinstance(value, str):
        value = rng.choice((toml_text({"v": value}).partition("= ")[2], repr(value)[:5000], "v\nw = 3", "[" * 3000))
    return rng.choice((".".join(words), "".join(f"[{word}]" for word in words), ".." + ".".join(words))), value


def names_a_key(fault: Fault, document: Any) -> bool:
    found = re.findall(r'"([^"]*)"|\[(\d+)\]|([^.\[\]"]+)', fault.key)
    parts, node = [int(index) if index else quoted or bare for quoted, index, bare in found], document
    for k, part in enumerate(parts):
        if isinstance(node, dict) and part in node or isinstance(node, list) and isinstance(part, int) and part < len(node):
            node = node[part]
            continue
        return k == len(parts) - 1
    return bool(parts)
