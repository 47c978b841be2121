"""`cost --overwrite` replaces what a study writes, when the new study is complete, and nothing else."""

import pytest

from thirdbody.errors import OutputError
from thirdbody.studies import cost_command as command
from thirdbody.studies.copies import StudySource
from thirdbody.studies.cost_command import StudyOptions, cost_command
from thirdbody.studies.folder import new_study_folder

NAMES = ("scene.toml", "cost.json", "cost.png", "cost.pdf", "variants/mdr_8/run.vtkhdf", "variants/mdr_8/checkpoint.npz",
         "variants/costliest/exact/scene.toml", "variants/mdr_8/.replacement/run.vtkhdf.part")  # fmt: skip


def write(folder, text, names=NAMES):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_text() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture
def old(tmp_path):
    write(tmp_path / "study", "old")
    return tmp_path / "study"


def test_a_complete_study_replaces_the_older_one(old, tmp_path):
    new = ("scene.toml", "effects.json", "variants/gravity/0/run.vtkhdf")
    with new_study_folder(old, overwrite=True) as place:
        write(place, "new", new)
        assert {name for name, text in contents(old).items() if text == "old"} == set(NAMES)
    assert contents(old) == dict.fromkeys(sorted(new), "new")
    assert sorted(path.name for path in old.iterdir()) == ["effects.json", "scene.toml", "variants"]
    # what a killed study left is no obstacle
    write(old, "killed", [".points.csv.12.part", "variants/mdr_8/.point.json.12.part"])
    with new_study_folder(old, overwrite=True) as place:
        assert list(place.iterdir()) == []
        write(place, "new")
    assert set(contents(old).values()) == {"new"} and len(contents(old)) == len(NAMES)
    # links are no files of a study
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "run.vtkhdf").write_text("mine")
    (old / "variants" / "link").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match=r"\(variants/link\)"), new_study_folder(old, overwrite=True):
        pass
    assert (tmp_path / "elsewhere" / "run.vtkhdf").read_text() == "mine"


def test_a_study_that_fails_leaves_the_older_one(old):
    before = contents(old)
    for error in (OutputError("the disk is full"), KeyboardInterrupt()):
        with pytest.raises(type(error)), new_study_folder(old, overwrite=True) as place:
            write(place, "new", NAMES[:5])
            raise error
        assert contents(old) == before and list(old.parent.iterdir()) == [old]


def test_other_files_are_named_and_stay(tmp_path):
    others = ("notes.md", "paper/draft.tex", "variants/notes.md", "variants/mdr_8/page.pdf", ".replacement/mine", "cost.csv")
    for number, name in enumerate(others):
        old = tmp_path / str(number)
        write(old, "old")
        write(old, "mine", [name])
        before, named = contents(old), name.partition("/")[0] if name.startswith(("paper", ".rep")) else name
        with pytest.raises(OutputError, match=rf"holds other files \({named}\)"):
            cost_command(StudySource(old / "scene.toml", {}, old, []), StudyOptions(3), True, False, print)
        assert contents(old) == before


def test_a_project_with_a_scene_is_no_study(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "study", lambda *_: pytest.fail("it was computed"))
    (tmp_path / "scene.toml").write_text("mine")
    for effects in (False, True):
        with pytest.raises(OutputError, match="is not the folder of a study"):
            cost_command(StudySource(tmp_path / "scene.toml", {}, tmp_path, []), StudyOptions(3, effects), True, False, print)
        assert contents(tmp_path) == {"scene.toml": "mine"}
