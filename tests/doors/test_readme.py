"""The README's first commands and its cover, the questions of the scenes, the commands of the guide."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

from PIL import Image

from thirdbody.scene.model import Scene

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_cover_is_what_the_first_commands_draw():
    """Frame, options and scene stand in the text chunks of the picture that `render` writes."""
    words = shlex.split(blocks("sh")[0])
    scene_file, at = words[words.index("run") + 1], words.index("render")
    given = words[at + 2 :]
    name = given[given.index("-o") + 1]
    (cover,) = re.findall(rf"!\[[^]]*\]\((scenes/{re.escape(name)})\)", README)
    with Image.open(ROOT / cover) as picture:
        size, texts = picture.size, picture.text
    assert {word for word in given if word.startswith("-")} == {"-o", "--width", "--height"}  # all others are the defaults
    frame, last = texts["frame"].split(" of 0 to ")
    assert frame == last  # without --frame the last
    options = json.loads(texts["options"])
    left = {name: value for name, value in options.items() if name != "size"}
    assert left == {"color": "state", "zoom": None, "view": "iso", "forces": False, "body": None}
    assert list(size) == options["size"] == [int(given[given.index(side) + 1]) for side in ("--width", "--height")]
    drawn, now = tomllib.loads(texts["scene"]), tomllib.loads(Scene.load(ROOT / scene_file).to_toml())
    for place in leaves(tomllib.loads((ROOT / scene_file).read_text(encoding="utf-8"))):
        assert at_place(drawn, place) == at_place(now, place), place


def leaves(value, place: tuple = ()):
    """Places of everything in a TOML file that is no table."""
    if isinstance(value, dict | list) and value and not (isinstance(value, list) and not isinstance(value[0], dict)):
        for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(entry, (*place, key))
    else:
        yield place


def at_place(value, place: tuple):
    for key in place:
        value = value[key]
    return value


def test_every_shipped_scene_opens_with_its_question():
    for path in sorted((ROOT / "scenes").glob("*.toml")):
        first = path.read_text(encoding="utf-8").splitlines()[0]
        assert first.startswith("#") and first.endswith("?"), path.name
        assert Scene.load(path).title


def test_the_guide_describes_every_command():
    guide = (ROOT / "src" / "thirdbody" / "README.md").read_text(encoding="utf-8")
    listed = subprocess.run([sys.executable, "-m", "thirdbody", "--help"], capture_output=True, text=True, check=True).stdout
    commands = {line.split()[0] for line in listed.partition("Commands:")[2].splitlines() if re.match(r"  [a-z]", line)}
    contract = {"new", "check", "run", "resume", "states", "render", "plot", "export", "laws", "cost", "balance", "map"}
    assert contract <= commands == set(re.findall(r"^\| `thirdbody ([a-z]+)", guide, re.MULTILINE))
