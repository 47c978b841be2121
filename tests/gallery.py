"""The gallery, scenes/README.md: `python tests/gallery.py [NAME ...]` runs the scenes (all: some ten minutes) and draws them.

It writes scenes/pictures/NAME.png and, into scenes/pictures/results.json, what the runs gave. `python tests/generated_parts.py`
makes the page of these and of the first lines of each scene."""

import hashlib
import json
import re
import resource
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import bed_rheology
import load_sharing
import shape_map
from pages import ROOT
from PIL import Image, PngImagePlugin
import thirdbody
from thirdbody.units import GLUE, MINUS, percent, quantity_text, with_error

SCENES, PICTURES = ROOT / "scenes", ROOT / "scenes" / "pictures"
RESULTS = PICTURES / "results.json"
# width of a picture in pixels, its colours, and processor seconds up to which the tests run a scene's commands
WIDTH, COLORS, QUICK = 800, 256, 8.0


class Entry(NamedTuple):
    draw: str = "render RUN -o PICTURE --width 800 --height 450"
    settings: str = ""


RENDER = Entry().draw
ENTRIES = {
    "roller_bearing": Entry(),
    "sliding_flakes": Entry(f"{RENDER} --zoom 0.3"),
    "grooves": Entry(f"{RENDER} --zoom 0.6"),
    "three_spot": Entry(f"{RENDER} --body 0 --frame 6"),
    "scanned_debris": Entry(f"{RENDER} --zoom 0.4"),
    "sheared_debris": Entry(),
    "million": Entry(RENDER, '--set debris.0.count=400 --set \'domain.size=["448 um", "336 um"]\' --set solver.distance="20 um"'),
    "yielding_debris": Entry(f"{RENDER} --zoom 0.3 --color plastic_work"),
    "mixed_population": Entry(f"{RENDER} --color population --forces"),
    "fretting": Entry("plot RUN -o PICTURE --panel loop"),
    "fretting_rig": Entry("plot RUN -o PICTURE --panel loop", "--set debris.0.count=200"),
    "wear_map": Entry(f"{RENDER} --plate lower --color wear_depth --cycles 1000 --height 500"),
    "worn_by_debris": Entry(f"{RENDER} --plate lower --color surface_wear --height 500"),
    "punch_on_flat": Entry(RENDER, '--set solver.duration="0.6 s"'),
    "ball_on_flat": Entry(RENDER, '--set solver.duration="3 s"'),
    "rough_plates": Entry(),
    "sticky_submicron": Entry(f"{RENDER} --color agglomerate --view side"),
    "dense_layer": Entry(f"{RENDER} --forces --view side"),
    "angular_bed": Entry(f"{RENDER} --forces --view side"),
    "balance/three_spot": Entry("balance SCENE -o PICTURE"),
    "sweeps/long_particle": Entry(f"{RENDER} --view side"),
    "sweeps/shape_against_friction": Entry("python tests/shape_map.py SWEEP -o PICTURE"),
    "sweeps/angular_debris": Entry(),
    "sweeps/rolling_against_friction": Entry("plot SWEEP -o PICTURE --panel friction_coefficient --panel fraction_rolling"),
    "sweeps/friction_against_pressure": Entry("python tests/load_sharing.py SWEEP -o PICTURE"),
    "sweeps/debris_against_stroke": Entry("plot SWEEP -o PICTURE --panel load_share_debris --panel inside"),
    "sweeps/sphere_bed": Entry(f"{RENDER} --color speed --view side"),
    "sweeps/mu_of_inertia": Entry("python tests/bed_rheology.py SWEEP -o PICTURE"),
}  # scenes in the order of the page


def picture(name: str) -> Path:
    return PICTURES / f"{name.replace('/', '_')}.png"


def digest(name: str) -> str:
    lines = [line for line in (SCENES / f"{name}.toml").read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:12]


def commands(name: str) -> list[str]:
    entry, file = ENTRIES[name], (SCENES / f"{name}.toml").relative_to(ROOT).as_posix()
    words = {"SCENE": file, "PICTURE": picture(name).name, "RUN": f"runs/{Path(name).name}", "SWEEP": f"sweeps/{Path(name).name}"}
    drawn, verb = entry.draw, next((verb for verb in ("run", "sweep") if verb.upper() in entry.draw), "")
    for word, text in words.items():
        drawn = drawn.replace(word, text)
    run = [f"thirdbody {verb} {file} {entry.settings}".rstrip()] if verb else []
    return [*run, drawn if drawn.startswith("python ") else f"thirdbody {drawn}"]


def measure(name: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        for part in ("scenes", "tests"):
            (Path(folder) / part).symlink_to(ROOT / part)
        start, seconds = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]), 0.0
        for command in commands(name):
            quiet = ["-q"] if " run " in command or " sweep " in command else []
            words = [*shlex.split(command), *(["--threads", "1"] if " run " in command else []), *quiet]
            words = words[1:] if words[0] == "python" else ["-m", *words]
            subprocess.run([sys.executable, *words], cwd=folder, check=True, stdout=subprocess.DEVNULL)
            # of the first command: drawing is not counted
            seconds = seconds or sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - start
        shrink(Path(folder) / picture(name).name, picture(name))
        measured = {"scene": digest(name), "seconds": round(seconds, 1)}
        end = Path(name).name
        return measured | results(Path(folder) / "runs" / end) | sweep_results(Path(folder) / "sweeps" / end)


def results(folder: Path) -> dict[str, Any]:
    if not folder.is_dir():
        return {}
    with thirdbody.open(folder) as run:
        report, friction = run.summary(), run.friction
        shares = {row["name"]: percent(row["load_share"]) for row in report["populations"] if "load_share" in row}
        texts = {
            "particles": str(report["bodies"]), "integrator": report["integrator"],
            "friction coefficient": with_error(friction.value, friction.error), "trend": friction.verdict,
            "energy per cycle": quantity_text(report["energy_per_cycle"], "J") if report.get("cycles") else "",
            "speed": report["speed_scale"]["text"] if report.get("speed_scale") else "",
            "bed": report.get("bed_verdict", ""),
            "states at the end": ", ".join(f"{percent(share)} {name}" for name, share in report["fractions"].items() if share),
            "share of the load": ", ".join(f"{name} {share}" for name, share in shares.items()) if len(shares) > 1 else "",
            "energy residual": f"{report['energy_residual']:.0e} of the work".replace("e-0", "e-"),
        }  # fmt: skip
        return {name: text.replace(GLUE, " ").replace(MINUS, "-") for name, text in texts.items() if text}


def sweep_results(folder: Path) -> dict[str, Any]:
    if not folder.is_dir():
        return {}
    table = thirdbody.Sweep(folder).to_pandas()
    done = int((table["status"] == "done").sum())
    texts = {"points": f"{len(table)}, {'all' if done == len(table) else done} done"}
    if folder.name == "shape_against_friction":
        found = shape_map.read_map(folder)
        off = abs(shape_map.boundary(found) / shape_map.closed_form(found.friction) - 1.0).max()
        texts["boundary"] = f"within {100.0 * off:.1f} % of the closed form at every friction; points are 2 % apart"
        texts["corrugation"] = shape_map.corrugation_text(found)
    elif folder.name == "mu_of_inertia":
        texts |= bed_rheology.texts(bed_rheology.read_sweep(folder))
    elif folder.name == "friction_against_pressure":
        texts |= load_sharing.texts(load_sharing.read_sweep(folder))
    elif folder.name == "debris_against_stroke":
        for stroke, part in table.groupby("plates.upper.motion.x.stroke")["load_share_debris"].mean().items():
            texts[f"share of the load on debris at {quantity_text(stroke, 'm')}"] = percent(part)
        texts = {name.replace(GLUE, " "): text.replace(GLUE, " ") for name, text in texts.items()}
    else:
        for mu, row in table.groupby("pairs.0.friction")["fraction_rolling"].agg(["mean", "sem"]).iterrows():
            texts[f"rolling at friction {mu:g}"] = f"{100.0 * row['mean']:.0f} ± {100.0 * row['sem']:.1f} %"
    return texts | {"energy residual": f"at most {table['energy_residual'].max():.0e} of the work".replace("e-0", "e-")}


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
    lines = (SCENES / f"{name}.toml").read_text(encoding="utf-8").splitlines()
    end = next(number for number, line in enumerate(lines) if not line.startswith("#"))
    comment = [line.lstrip("# ") for line in lines[:end]]
    return comment[0], " ".join(comment[1:]).strip()


def gallery() -> str:
    measured = json.loads(RESULTS.read_text(encoding="utf-8"))
    index = ", ".join(f"[`{name}`](#{name.replace('/', '')})" for name in ENTRIES)
    return f"{index}.\n\n" + "\n\n".join(_section(name, measured[name]) for name in ENTRIES)


def _section(name: str, measured: dict[str, Any]) -> str:
    question, text = header(name)
    entry, results = ENTRIES[name], _results(measured)
    answer = re.sub(r"Expect: (\w)", lambda found: found[1].upper(), text)
    parts = [f"## {name}", f"**{question.partition(' (')[0]}**", f"![{name}](pictures/{picture(name).name})", answer]
    # running and drawing as at the top of the page is not repeated
    standard = entry.draw.startswith(RENDER)
    options = entry.draw.removeprefix(RENDER).strip() if standard else ""
    lines = commands(name)[: 1 if standard else None] if entry.settings or not standard else []
    if lines:
        long = f"<!-- not run: {measured['seconds']:.0f} s -->\n" if measured["seconds"] > QUICK else ""
        parts.append(long + "```sh\n" + "\n".join(lines) + "\n```")
    last = ["This shorter run:" * bool(entry.settings), results, f"Drawn with `{options}`." * bool(options)]
    return "\n\n".join([*parts, " ".join(filter(None, last))]).rstrip()


def _results(measured: dict[str, Any]) -> str:
    """Return a line on what a run or a sweep gave; results.json has all of it."""
    seconds = f"{measured['seconds']:.0f} s"
    if "points" in measured:
        points = f"{measured['points'].partition(',')[0]} points, {seconds}"
        return f"{points}: {measured['boundary']}." if "boundary" in measured else f"{points}."
    if "particles" not in measured:
        return ""
    verdict, _, why = measured["trend"].partition(": ")
    trend = "no clear trend" if why.startswith("its scatter") else verdict.partition(" over ")[0]
    energy, loads = (measured.get(key, "") for key in ("energy per cycle", "share of the load"))
    states = ", ".join(text for text in measured["states at the end"].split(", ") if not text.startswith("0."))
    parts = [f"friction {measured['friction coefficient']}, {trend}", energy and f"{energy} per cycle", states]
    particles = f"{measured['particles']} particle{'s' * (measured['particles'] != '1')}"
    return f"{particles}, {seconds}: {'; '.join(filter(None, [*parts, loads and f'load on {loads}']))}."


def main(names: list[str]) -> None:
    measured = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.is_file() else {}
    for name in names or ENTRIES:
        measured[name] = measure(name)
        print(name, measured[name], flush=True)
        RESULTS.write_text(json.dumps({name: measured[name] for name in ENTRIES if name in measured}, indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
