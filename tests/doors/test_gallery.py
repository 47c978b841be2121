"""The gallery: every scene has its entry, made from the scene as it is, and a small picture."""

from __future__ import annotations

import json

import pytest
from gallery import ENTRIES, RESULTS, SCENES, WIDTH, digest, header, picture
from pages import Page
from PIL import Image

KILOBYTES = 150
SCENE_FILES = sorted(path.relative_to(SCENES).with_suffix("").as_posix() for path in SCENES.rglob("*.toml"))
MEASURED = json.loads(RESULTS.read_text(encoding="utf-8"))


def test_every_scene_has_an_entry():
    assert sorted(ENTRIES) == SCENE_FILES == sorted(MEASURED)


@pytest.mark.parametrize("name", SCENE_FILES)
def test_results_and_picture_are_of_the_scene_as_it_is(name):
    assert MEASURED[name]["scene"] == digest(name), f"python tests/gallery.py {name}"
    file = picture(name)
    assert file.stat().st_size < KILOBYTES * 1000
    with Image.open(file) as image:
        assert image.width <= WIDTH and image.height <= 1.2 * WIDTH
        if "scene" in image.text and not ENTRIES[name].settings:
            assert json.loads(image.text["options"])


@pytest.mark.parametrize("name", SCENE_FILES)
def test_a_scene_opens_with_its_question_and_what_to_expect(name):
    question, text = header(name)
    assert question.partition(" (")[0].endswith("?") and "Expect" in text


def test_sentences_are_short():
    page = Page(SCENES / "README.md")
    long = [sentence for sentence in page.sentences if len(sentence.split()) > 35]
    assert len(page.pictures) == len(SCENE_FILES) and not long


def test_no_other_pictures_are_kept():
    assert {path.name for path in RESULTS.parent.iterdir()} == {RESULTS.name} | {picture(name).name for name in ENTRIES}
