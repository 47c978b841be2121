"""The gallery, scenes/README.md: `python tests/gallery.py [NAME ...]` runs the scenes (all: some ten minutes) and draws them.

It writes scenes/pictures/NAME.png and, into scenes/pictures/results.json, what the runs gave. `python tests/generated_parts.py`
makes the page of these and of the first lines of each scene.
"""

from __future__ import annotations

import hashlib
import json
import resource
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from pages import ROOT
from PIL import Image, PngImagePlugin

import thirdbody
from thirdbody.quantity import GLUE, MINUS, percent, quantity_text, with_error

SCENES, PICTURES = ROOT / "scenes", ROOT / "scenes" / "pictures"
RESULTS = PICTURES / "results.json"
WIDTH, COLORS, QUICK = 800, 256, 8.0
"""Width of a picture in pixels, its colours, and processor seconds up to which the tests run a scene's commands."""


@dataclass(frozen=True)
class Entry:
    """How a scene is drawn, and which settings shorten it."""

    draw: str = "render RUN -o PICTURE --width 800 --height 450"
    settings: str = ""


RENDER = Entry.draw
ENTRIES = {
    "roller_bearing": Entry(),
    "sliding_flakes": Entry(f"{RENDER} --zoom 0.3"),
    "three_spot": Entry(f"{RENDER} --body 0 --frame 6"),
    "scanned_debris": Entry(f"{RENDER} --zoom 0.4"),
    "sheared_debris": Entry(),
    "mixed_population": Entry(f"{RENDER} --color population --forces"),
    "fretting": Entry("plot RUN -o PICTURE --panel loop"),
    "fretting_rig": Entry("plot RUN -o PICTURE --panel loop", "--set debris.0.count=200"),
    "dense_layer": Entry(f"{RENDER} --forces --view side"),
    "balance/three_spot": Entry("balance SCENE -o PICTURE"),
}
"""Scenes in the order of the page."""


def scene_file(name: str) -> Path:
    """Return the file of a scene."""
    return SCENES / f"{name}.toml"


def picture(name: str) -> Path:
    """Return the picture of a scene."""
    return PICTURES / f"{name.replace('/', '_')}.png"


def digest(name: str) -> str:
    """Return a short digest of what a scene says besides its comments."""
    lines = [line for line in scene_file(name).read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:12]


def commands(name: str) -> list[str]:
    """Return the commands that run and draw a scene, from the top of the project."""
    entry, file = ENTRIES[name], scene_file(name).relative_to(ROOT).as_posix()
    drawn = entry.draw.replace("SCENE", file).replace("PICTURE", picture(name).name).replace("RUN", f"runs/{Path(name).name}")
    run = [f"thirdbody run {file} {entry.settings}".rstrip()] if "RUN" in entry.draw else []
    return [*run, f"thirdbody {drawn}"]


def measure(name: str) -> dict[str, Any]:
    """Run and draw a scene; return what it gave."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scenes").symlink_to(SCENES)
        start, seconds = _processor_time(), 0.0
        for command in commands(name):
            words = [sys.executable, "-m", *shlex.split(command), *(["--threads", "1", "-q"] if " run " in command else [])]
            subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)
            seconds = seconds or _processor_time() - start  # of the first command; drawing is not counted
        shrink(Path(folder) / picture(name).name, picture(name))
        return {"scene": digest(name), "seconds": round(seconds, 1)} | results(Path(folder) / "runs" / Path(name).name)


def _processor_time() -> float:
    """Return the processor time [s] of all ended processes that this one started."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def results(folder: Path) -> dict[str, Any]:
    """Return the numbers of a run that the page shows; none without a run."""
    if not folder.is_dir():
        return {}
    with thirdbody.open(folder) as run:
        report, friction = run.summary(), run.friction
        shares = {row["name"]: percent(row["load_share"]) for row in report["populations"] if "load_share" in row}
        texts = {
            "particles": str(report["bodies"]),
            "integrator": report["integrator"],
            "friction coefficient": with_error(friction.value, friction.error),
            "trend": friction.verdict,
            "energy per cycle": quantity_text(report["energy_per_cycle"], "J") if report.get("cycles") else "",
            "states at the end": ", ".join(f"{percent(share)} {name}" for name, share in report["fractions"].items() if share),
            "share of the load": ", ".join(f"{name} {share}" for name, share in shares.items()) if len(shares) > 1 else "",
            "energy residual": f"{report['energy_residual']:.0e} of the work".replace("e-0", "e-"),
        }
        return {name: text.replace(GLUE, " ").replace(MINUS, "-") for name, text in texts.items() if text}


def shrink(source: Path, target: Path) -> None:
    """Write a picture of at most WIDTH pixels and COLORS colours, with the text chunks of the original."""
    with Image.open(source) as image:
        texts = PngImagePlugin.PngInfo()
        for key, value in getattr(image, "text", {}).items():
            texts.add_text(key, value, zip=True)
        plain = image.convert("RGB")
        if plain.width > WIDTH:
            plain = plain.resize((WIDTH, round(plain.height * WIDTH / plain.width)), Image.Resampling.LANCZOS)
        target.parent.mkdir(exist_ok=True)
        plain.quantize(COLORS, kmeans=8, dither=Image.Dither.NONE).save(target, pnginfo=texts, optimize=True)


def header(name: str) -> tuple[str, str]:
    """Return the question in the first line of a scene, and the text of the comment below it."""
    lines = scene_file(name).read_text(encoding="utf-8").splitlines()
    end = next(number for number, line in enumerate(lines) if not line.startswith("#"))
    comment = [line.lstrip("# ") for line in lines[:end]]
    return comment[0], " ".join(comment[1:]).strip()


def gallery() -> str:
    """Return the page's list of scenes, and a section for each."""
    measured = json.loads(RESULTS.read_text(encoding="utf-8"))
    rows = ["| scene | question | processor time |", "| --- | --- | --- |"]
    for name in ENTRIES:
        question = header(name)[0]
        rows.append(f"| [`{name}`](#{_anchor(name)}) | {question} | {measured[name]['seconds']:.0f} s |")
    return "\n".join(rows) + "\n\n" + "\n\n".join(_section(name, measured[name]) for name in ENTRIES)


def _anchor(name: str) -> str:
    return name.replace("/", "")


def _section(name: str, measured: dict[str, Any]) -> str:
    question, text = header(name)
    parts = [f"## {name}", f"**{question}**", f"![{question}](pictures/{picture(name).name})", text]
    if ENTRIES[name].settings:
        parts.append(f"Picture and numbers are of a shorter run: `{ENTRIES[name].settings}`.")
    for why, lines in groupby(commands(name), key=lambda command: _why_not_run(command, measured["seconds"])):
        parts.append((f"<!-- not run: {why} -->\n" if why else "") + "```sh\n" + "\n".join(lines) + "\n```")
    shown = {key: value for key, value in measured.items() if key not in ("scene", "seconds")}
    if shown:
        rows = [f"| {key} | {value} |" for key, value in shown.items()]
        parts.append("| to expect | |\n| --- | --- |\n" + "\n".join(rows))
    return "\n\n".join(parts)


def _why_not_run(command: str, seconds: float) -> str:
    """Return why the tests of pages do not run a command; an empty text if they do."""
    if seconds > QUICK:
        return f"{seconds:.0f} s"
    return "pictures need OpenGL" if " render " in command else ""


def main(names: list[str]) -> None:
    """Measure the scenes, all without names, one after the other."""
    measured = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.is_file() else {}
    for name in names or ENTRIES:
        measured[name] = measure(name)
        print(name, measured[name], flush=True)
        RESULTS.write_text(json.dumps({name: measured[name] for name in ENTRIES if name in measured}, indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
