"""The pages of the project: blocks run, links lead somewhere, generated parts are those of the source, the English is plain."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from generated_parts import PART, PARTS, regenerated
from pages import LANGUAGES, ROOT, Block, Page, pages

from thirdbody.assembly.physics import compile_physics
from thirdbody.errors import InputError
from thirdbody.laws.registry import discover
from thirdbody.scene.model import Scene
from thirdbody.scene.template import TEMPLATE
from thirdbody.studies.sweep.sweep import plan_of_path

PAGES = [Page(path) for path in pages()]
README = PAGES[0]
every_page = pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
DMT = ROOT / "plugins" / "dmt_adhesion.py"
LONGEST_SENTENCE, MOST_LINES = 35, 160  # of the README
WORDS = ("statics", "Strack")  # right, though codespell corrects them


@every_page
def test_blocks_are_of_known_languages(page):
    assert {block.language for block in page.blocks} <= set(LANGUAGES)
    assert page.text.count("```") == 2 * len(page.blocks), "a fence that is not closed, or is indented"


@every_page
def test_blocks_run(page, tmp_path, monkeypatch):
    """In the order of the page, in one folder, the Python blocks with one set of names."""
    for folder in ("scenes", "plugins", "tests"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    names: dict = {"__name__": "page"}
    for block in page.blocks:
        if block.file:
            (tmp_path / block.file).write_text(block.text, encoding="utf-8")
        if block.language == "python" and not block.not_run:
            exec(compile(block.text, page.name, "exec"), names)
        if block.language == "sh" and not block.not_run:
            _shell(block.text)


def _shell(text: str) -> None:
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", text], capture_output=True, text=True)
    assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"


@every_page
def test_commands_that_are_not_run_exist(page):
    """Commands of blocks that say why they are not run, and of the prose: name, options, files of the project."""
    blocks = [block.text for block in page.blocks if block.language == "sh" and block.not_run]
    inline = [code for code in page.inline if re.match(r"(thirdbody|pytest|python) ", code)]
    for line in "\n".join(blocks).replace("\\\n", " ").splitlines() + inline:
        words = shlex.split(line, comments=True)
        if words[:1] == ["thirdbody"] and words[1:]:
            _is_command(words)
        for word in words:
            if re.fullmatch(r"(scenes|plugins|tests)/[\w./]+", word.partition("::")[0]):
                assert (ROOT / word.partition("::")[0]).exists(), word


def _is_command(words: list[str]) -> None:
    if words[1].startswith("-"):
        assert words[1] in _help(""), words
        return
    if not re.fullmatch(r"[a-z]+", words[1]):  # a command as a placeholder
        return
    text = _help(words[1])
    for option in (word.partition("=")[0] for word in words[2:] if re.match(r"--?[a-z]", word)):
        assert re.search(rf"(?<![\w-]){option}(?![\w-])", text), f"{words[1]} has no {option}"


@cache
def _help(command: str) -> str:
    words = [sys.executable, "-m", "thirdbody", *([command] if command else []), "--help"]
    done = subprocess.run(words, capture_output=True, text=True, env=os.environ | {"COLUMNS": "200"})
    assert done.returncode == 0, f"no command {command}"
    return done.stdout


@every_page
def test_toml_blocks_are_scenes(page, tmp_path):
    """A block with `scene = 1` is a whole scene, one with `sweep = 1` a sweep; others are laid over the scene of `new`."""
    registry = discover([DMT])
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    for block in page.blocks:
        if block.language == "toml" and "sweep" in tomllib.loads(block.text):
            (tmp_path / "sweep.toml").write_text(block.text, encoding="utf-8")
            plan, _ = plan_of_path(tmp_path / "sweep.toml", None)
            assert len(plan.points) > 1
        elif block.language == "toml" and not block.not_run:
            scene = _scene(block)
            if not scene.effects.model_dump(exclude_none=True) and "contact" not in block.text:
                continue
            compile_physics(scene, registry)  # options of laws and effects are checked there


def _scene(block: Block) -> Scene:
    given = tomllib.loads(block.text)
    if "scene" in given:
        return Scene.parse(block.text, folder=ROOT / "scenes")
    try:
        return Scene.of(_laid_over(tomllib.loads(TEMPLATE), given, 3))
    except InputError as problem:
        pytest.fail(f"{block.text}\n{problem}")


def _laid_over(base, given, depth: int):
    """Tables of `given` over those of `base`, down to a depth; a key replaces those that exclude it (load and pressure)."""
    if depth == 0 or not isinstance(base, dict) or not isinstance(given, dict):
        return given
    rivals = ({"load", "pressure", "gap"}, {"distance", "duration"})
    kept = {key: value for key, value in base.items() if not any(key in group and group & given.keys() for group in rivals)}
    return kept | {key: _laid_over(base.get(key), value, depth - 1) for key, value in given.items()}


@every_page
def test_links_lead_somewhere(page):
    for target in page.links:
        if re.match(r"[a-z]+:", target):
            continue
        file, _, anchor = target.partition("#")
        path = (page.path.parent / file).resolve() if file else page.path
        path = path / "README.md" if anchor and path.is_dir() else path
        assert path.exists(), target
        if anchor and path.suffix == ".md":
            assert anchor in Page(path).anchors, target


@every_page
def test_generated_parts_are_those_of_the_source(page):
    assert regenerated(page.text) == page.text, "python tests/generated_parts.py writes them anew"


def test_every_generator_has_a_page():
    shown = [name for page in PAGES for _, name, _, _ in PART.findall(page.text)]
    assert sorted(shown) == sorted(PARTS)


@every_page
def test_decimals_begin_with_a_digit(page):
    assert not re.findall(r"(?:^|[\s(|~<>=+-])\.\d+[^|\n]{0,20}", page.prose)


@every_page
def test_paths_in_the_text_exist(page):
    for code in page.inline:
        name, _, test = code.partition("::")
        if re.fullmatch(r"(src|plugins|tests|scenes)/[\w/.-]+", name):
            assert (ROOT / name).exists(), code
            assert not test or re.search(rf"^\s*(def|class) {test}\b", (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE), (
                code
            )


def test_spelling():
    """Pages and scenes, by codespell's list of common misspellings."""
    scenes = sorted((ROOT / "scenes").rglob("*.toml"))
    words = [sys.executable, "-m", "codespell_lib", "-L", ",".join(WORDS), *(str(path) for path in (*pages(), *scenes))]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_readme_is_short():
    assert len(README.text.splitlines()) <= MOST_LINES
    long = [sentence for sentence in README.sentences if len(sentence.split()) > LONGEST_SENTENCE]
    assert not long, long


def test_citation_has_the_version_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (citation,) = (block.text for block in README.blocks if block.language == "yaml")
    assert f"\nversion: {project['version']}\nlicense: {project['license']}\n" in citation
