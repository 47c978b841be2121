"""Pages: blocks run, links lead somewhere, generated parts are of the source, the gallery of the scenes, the English is plain."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from functools import cache

import pytest
from each import each
from gallery import ENTRIES, RESULTS, SCENES, WIDTH, digest, header, picture
from generated_parts import PART, PARTS, regenerated
from pages import LANGUAGES, ROOT, Page, pages
from PIL import Image
from thirdbody.assembly.physics import law_faults
from thirdbody.errors import InputError
from thirdbody.laws.registry import discover
from thirdbody.scene.model import Scene
from thirdbody.studies.sweep import plan_of_path

PAGES = [Page(path) for path in pages()]
README = PAGES[0]
PACKAGE = ROOT / "src" / "thirdbody"
LONGEST_SENTENCE, KILOBYTES = 35, 150  # words; of a picture
MOST_WORDS = {"README.md": 1200, "src/README.md": 2500}  # of all pages together, ALL_WORDS
ALL_WORDS = 27_000
WORDS = ("statics", "Strack")  # right, though codespell corrects them
RUN = [page for page in PAGES if any(block.language in ("python", "sh") and not block.not_run for block in page.blocks)]


@cache
def anchors(path):
    return Page(path).anchors


@each(PAGES, lambda page: page.name)
def test_languages_links_paths_decimals_and_generated_parts(page):
    assert {block.language for block in page.blocks} <= set(LANGUAGES)
    assert page.text.count("```") == 2 * len(page.blocks), "a fence that is not closed, or is indented"
    assert regenerated(page.text) == page.text, "python tests/generated_parts.py writes them anew"
    assert not re.findall(r"(?:^|[\s(|~<>=+-])\.\d+[^|\n]{0,20}", page.prose), "a decimal begins with a digit"
    for target in (target for target in page.links if not re.match(r"[a-z]+:", target)):
        file, _, anchor = target.partition("#")
        path = (page.path.parent / file).resolve() if file else page.path
        path = path / "README.md" if anchor and path.is_dir() else path
        assert path.exists(), target
        assert not anchor or path.suffix != ".md" or anchor in anchors(path), target
    for code in page.inline:
        name, _, test = code.partition("::")
        if re.fullmatch(r"(src|plugins|tests|scenes)/[\w/.-]+", name):
            assert (ROOT / name).exists(), code
            text = (ROOT / name).read_text(encoding="utf-8") if test else ""
            assert not test or re.search(rf"^\s*(def|class) {test}\b", text, re.MULTILINE), code


# other pages than the first run scenes for long
LONG = [pytest.param(page, marks=[] if page is README else pytest.mark.full(kind="slow"), id=page.name) for page in RUN]


@pytest.mark.parametrize("page", LONG)
def test_blocks_run(page, tmp_path, monkeypatch, command):
    for folder in ("scenes", "plugins", "tests"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{os.path.dirname(sys.executable)}{os.pathsep}{os.environ['PATH']}")
    names: dict = {"__name__": "page"}
    for block in page.blocks:
        if block.file:
            (tmp_path / block.file).write_text(block.text, encoding="utf-8")
        if block.language == "python" and not block.not_run:
            exec(compile(block.text, page.name, "exec"), names)
        if block.language == "sh" and not block.not_run:
            lines = [shlex.split(line, comments=True) for line in block.text.replace("\\\n", "").splitlines()]
            if page is README and all(words[0] == "thirdbody" for words in lines):
                one = {"run": ("--threads", "1")}
                assert not any(command(*words[1:], *one.get(words[1], ())).code for words in lines), block.text
                continue
            done = subprocess.run(["bash", "-euo", "pipefail", "-c", block.text], capture_output=True, text=True)
            assert done.returncode == 0, f"{block.text}\n{done.stdout}\n{done.stderr}"


def test_commands_that_are_not_run_exist(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    helps: dict[str, str] = {}
    for page in PAGES:
        blocks = [block.text for block in page.blocks if block.language == "sh" and block.not_run]
        inline = [code for code in page.inline if re.match(r"(thirdbody|pytest|python) ", code)]
        for line in "\n".join(blocks).replace("\\\n", " ").splitlines() + inline:
            words = shlex.split(line, comments=True)
            for word in words:
                if re.fullmatch(r"(scenes|plugins|tests)/[\w./]+", word.partition("::")[0]):
                    assert (ROOT / word.partition("::")[0]).exists(), (page.name, word)
            if words[:1] != ["thirdbody"] or not re.match(r"-|[a-z]+$", "".join(words[1:2])):  # another program, a placeholder
                continue
            name = "" if words[1].startswith("-") else words[1]
            if name not in helps:
                report = command(*filter(None, [name]), "--help")
                assert report.code == 0, f"no command {name}"
                helps[name] = report.out
            for option in (word.partition("=")[0] for word in words[1:] if re.match(r"--?[a-zA-Z]", word)):
                assert re.search(rf"(?<![\w-]){option}(?![\w-])", helps[name]), f"{page.name}: {name} has no {option}"


def test_toml_blocks_are_scenes(tmp_path):
    """A block with `scene = 1` is a whole scene, one with `sweep = 1` a sweep; others are laid over the scene of `new`."""
    registry = discover([ROOT / "plugins" / "dmt_adhesion.py"])
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    for block in (block for page in PAGES for block in page.blocks if block.language == "toml"):
        if "sweep" in tomllib.loads(block.text):
            (tmp_path / "sweep.toml").write_text(block.text, encoding="utf-8")
            plan, _ = plan_of_path(tmp_path / "sweep.toml", None)
            assert len(plan.points) > 1
        elif not block.not_run:
            assert not law_faults(scene_of(block), registry), block.text


def scene_of(block):
    given = tomllib.loads(block.text)
    if "scene" in given:
        return Scene.parse(block.text, folder=ROOT / "scenes")
    try:
        return Scene.of(laid_over(tomllib.loads((ROOT / "plugins" / "new_scene.toml").read_text(encoding="utf-8")), given, 3))
    except InputError as problem:
        pytest.fail(f"{block.text}\n{problem}")


def laid_over(base, given, depth):
    """Tables of `given` over those of `base`, down to a depth; a key replaces those that exclude it (load and pressure)."""
    if depth == 0 or not isinstance(base, dict) or not isinstance(given, dict):
        return given
    rivals = ({"load", "pressure", "gap"}, {"distance", "duration"})
    left = {key: value for key, value in base.items() if not any(key in group and group & given.keys() for group in rivals)}
    return left | {key: laid_over(base.get(key), value, depth - 1) for key, value in given.items()}


def test_every_generator_has_a_page_and_modules_that_the_page_of_the_source_names_exist():
    shown = [name for page in PAGES for _, name, _, _ in PART.findall(page.text)]
    assert sorted(shown) == sorted(PARTS)
    packages = {path.name for path in PACKAGE.iterdir() if path.is_dir()}
    text = (ROOT / "src" / "README.md").read_text(encoding="utf-8")
    names = {name for name in re.findall(r"`([a-z_]+(?:\.[a-z_]+)*)`", text) if name.split(".")[0] in packages}
    missing = []
    for name in names:  # a package, a module, or a name at the top of a module
        path = PACKAGE.joinpath(*name.split("."))
        module = path.parent.with_suffix(".py")
        top = rf"(?m)^(def|class) {path.name}\b|^{path.name}\b.*="
        if not (path.is_dir() or path.with_suffix(".py").is_file()):
            missing += [] if module.is_file() and re.search(top, module.read_text(encoding="utf-8")) else [name]
    assert len(names) > 20 and not missing, missing


def test_spelling():
    scenes = sorted((ROOT / "scenes").rglob("*.toml"))
    words = [sys.executable, "-m", "codespell_lib", "-L", ",".join(WORDS), *(str(path) for path in (*pages(), *scenes))]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_pages_are_short_in_words_and_sentences():
    words = {page.name: len(page.text.split()) for page in PAGES}
    assert all(words[name] <= most for name, most in MOST_WORDS.items()) and sum(words.values()) <= ALL_WORDS, words
    long = [sentence for page in PAGES for sentence in page.sentences if len(sentence.split()) > LONGEST_SENTENCE]
    assert not long


def test_the_readme_is_cited_and_the_guide_describes_every_command(command):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (citation,) = (block.text for block in README.blocks if block.language == "yaml")
    assert f"\nversion: {project['version']}\nlicense: {project['license']}\n" in citation
    guide = (PACKAGE / "README.md").read_text(encoding="utf-8")
    listed = command("--help").out.partition("Commands:")[2]
    commands = {line.split()[0] for line in listed.splitlines() if re.match(r"  [a-z]", line)}
    contract = {"new", "check", "run", "resume", "states", "render", "plot", "export", "laws", "cost", "balance", "map"}
    assert contract <= commands == set(re.findall(r"^\| `thirdbody ([a-z]+)", guide, re.MULTILINE))


SCENE_FILES = sorted(path.relative_to(SCENES).with_suffix("").as_posix() for path in SCENES.rglob("*.toml"))
MEASURED = json.loads(RESULTS.read_text(encoding="utf-8"))


def leaves(value, place=()):
    if isinstance(value, dict | list) and value and not (isinstance(value, list) and not isinstance(value[0], dict)):
        for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(entry, (*place, key))
    else:
        yield place, value


def test_the_cover_is_what_the_first_commands_draw():
    words = shlex.split(next(block.text for block in README.blocks if block.language == "sh"))
    file, given = ROOT / words[words.index("run") + 1], words[words.index("render") + 2 :]
    name = given[given.index("-o") + 1]
    (cover,) = re.findall(rf"!\[[^]]*\]\((scenes/{re.escape(name)})\)", README.text)
    with Image.open(ROOT / cover) as image:
        size, texts = image.size, image.text
    assert {word for word in given if word.startswith("-")} == {"-o", "--width", "--height"}  # all others are the defaults
    frame, last = texts["frame"].split(" of 0 to ")
    assert frame == last  # without --frame the last
    options = json.loads(texts["options"])
    left = {name: value for name, value in options.items() if name != "size"}
    assert left == {"color": "state", "zoom": None, "view": "iso", "forces": False, "body": None}
    assert list(size) == options["size"] == [int(given[given.index(side) + 1]) for side in ("--width", "--height")]
    drawn, now = (dict(leaves(tomllib.loads(text))) for text in (texts["scene"], Scene.load(file).to_toml()))
    for place, _ in leaves(tomllib.loads(file.read_text(encoding="utf-8"))):
        assert drawn[place] == now[place], place


@each(SCENE_FILES)
def test_results_and_picture_are_of_the_scene_as_it_is(name):
    assert MEASURED[name]["scene"] == digest(name), f"python tests/gallery.py {name}"
    assert picture(name).stat().st_size < KILOBYTES * 1000
    with Image.open(picture(name)) as image:
        assert image.width <= WIDTH and image.height <= 1.2 * WIDTH
        if "scene" in image.text and not ENTRIES[name].settings:
            assert json.loads(image.text["options"])


@each(SCENE_FILES)
def test_a_scene_opens_with_its_question_and_what_to_expect(name):
    question, text = header(name)
    assert question.partition(" (")[0].endswith("?") and "Expect" in text
    assert "/" in name or Scene.load(SCENES / f"{name}.toml").title


def test_the_page_of_scenes_shows_every_scene():
    page = Page(SCENES / "README.md")
    assert sorted(ENTRIES) == SCENE_FILES == sorted(MEASURED) and len(page.pictures) == len(SCENE_FILES)
    assert {path.name for path in RESULTS.parent.iterdir()} == {RESULTS.name} | {picture(name).name for name in ENTRIES}
