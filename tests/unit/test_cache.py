"""Where compiled code is kept: only where no other user can write, and what may be deleted."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest

from thirdbody.errors import OutputError
from thirdbody.jit import cache_dir

OTHER_USER = 54321
needs_modes = pytest.mark.skipif(os.name == "nt", reason="needs the users and modes of POSIX")


@pytest.fixture
def surroundings(tmp_path, monkeypatch) -> Path:
    """A home, a folder for temporary files, a current folder, none of the variables, and a place not yet chosen."""
    for name in ("home", "temporary", "current"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv(cache_dir.VARIABLE, "")  # restored afterwards, also where the code sets it
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setattr(cache_dir, "_cached_folder", None)
    monkeypatch.chdir(tmp_path / "current")
    return tmp_path


@pytest.fixture
def fallback(surroundings, monkeypatch) -> Path:
    """The folder among temporary files that is taken without a usable home."""
    (surroundings / "home" / ".cache").write_text("a file where a folder should be")
    return surroundings / "temporary" / f"thirdbody-{os.geteuid() if hasattr(os, 'geteuid') else 'user'}"


def mode(path: Path) -> int:
    return stat.S_IMODE(path.lstat().st_mode)


# the parent ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [None, "", "relative/folder"])
def test_a_cache_home_that_names_no_folder_counts_as_unset(value, surroundings, monkeypatch):
    if value is not None:
        monkeypatch.setenv("XDG_CACHE_HOME", value)
    assert cache_dir.cache_folder().parent == surroundings / "home" / ".cache" / "thirdbody"
    assert list((surroundings / "current").iterdir()) == []


def test_an_absolute_cache_home_is_used(surroundings, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(surroundings / "caches"))
    assert cache_dir.cache_folder().parent == surroundings / "caches" / "thirdbody"


@pytest.mark.parametrize("home", [None, "", "relative"])
def test_without_a_home_compiled_code_goes_to_temporary_files(home, surroundings, monkeypatch):
    pwd = pytest.importorskip("pwd")

    def unknown(_user):
        raise KeyError("no such user")

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    if home is None:
        monkeypatch.delenv("HOME")
    else:
        monkeypatch.setenv("HOME", home)
    assert cache_dir.cache_folder().parent.parent == surroundings / "temporary"
    assert list((surroundings / "current").iterdir()) == []


def test_the_variable_names_the_parent(surroundings, monkeypatch):
    monkeypatch.setenv(cache_dir.VARIABLE, "here")
    assert cache_dir.cache_folder().parent == surroundings / "current" / "here"


def test_a_named_folder_that_cannot_be_written_is_refused(surroundings, monkeypatch):
    (surroundings / "file").write_text("")
    monkeypatch.setenv(cache_dir.VARIABLE, str(surroundings / "file" / "folder"))
    with pytest.raises(OutputError, match="compiled code cannot be written") as report:
        cache_dir.cache_folder()
    assert str(surroundings / "file") in str(report.value) and "\n" not in str(report.value)


@needs_modes
def test_the_folder_in_the_home_is_closed_to_others(surroundings):
    parent = surroundings / "home" / ".cache" / "thirdbody"
    parent.mkdir(parents=True)
    parent.chmod(0o775)
    assert cache_dir.cache_folder().parent == parent
    assert mode(parent) & 0o022 == 0 and mode(cache_dir.cache_folder()) == 0o700


@needs_modes
def test_a_home_of_another_user_is_not_used(surroundings, monkeypatch):
    """As with `sudo`, which may keep HOME."""
    parent = surroundings / "home" / ".cache" / "thirdbody"
    parent.mkdir(parents=True)
    real = cache_dir._probe

    def owned_by_other(path):
        found = list(real(path))
        found[stat.ST_UID] = OTHER_USER
        return os.stat_result(found)

    monkeypatch.setattr(cache_dir, "_probe", owned_by_other)
    assert not cache_dir._usable(parent)


# the fallback -------------------------------------------------------------------------------------------------------------


@needs_modes
def test_the_fallback_is_private_and_used_again(fallback, monkeypatch):
    first = cache_dir.cache_folder()
    assert first.parent == fallback and mode(fallback) == 0o700
    monkeypatch.setattr(cache_dir, "_cached_folder", None)
    assert cache_dir.cache_folder() == first


def plant_a_link(path: Path) -> None:
    (path.parent / "elsewhere").mkdir(mode=0o700)
    path.symlink_to(path.parent / "elsewhere")


def plant_an_open_folder(path: Path) -> None:
    path.mkdir()
    path.chmod(0o777)


def plant_a_readable_folder(path: Path) -> None:
    path.mkdir()
    path.chmod(0o755)


PLANTED = {
    "a symbolic link": plant_a_link,
    "a folder that all can write": plant_an_open_folder,
    "a folder that all can read": plant_a_readable_folder,
    "a file": lambda path: path.write_text(""),
}


@needs_modes
@pytest.mark.parametrize("plant", PLANTED.values(), ids=PLANTED)
def test_what_is_planted_as_the_fallback_is_not_used(plant, fallback):
    plant(fallback)
    check_fresh(fallback)


@needs_modes
def test_a_fallback_of_another_user_is_not_used(fallback, monkeypatch):
    """Here this user plants it and another one starts the program."""
    planted = fallback.with_name(f"thirdbody-{OTHER_USER}")
    planted.mkdir(mode=0o700)
    monkeypatch.setattr(os, "geteuid", lambda: OTHER_USER)
    check_fresh(planted)


def check_fresh(planted: Path) -> None:
    """A new folder that only this user can enter, which the processes started by this one find too."""
    parent = cache_dir.cache_folder().parent
    assert parent != planted and parent.parent == planted.parent and not parent.is_symlink()
    assert mode(parent) == 0o700 and os.environ[cache_dir.VARIABLE] == str(parent)
    assert not planted.is_dir() or list(planted.iterdir()) == []


# the folder of a version --------------------------------------------------------------------------------------------------


@pytest.fixture
def version(surroundings, monkeypatch) -> Path:
    """The path of the folder that the next call of `cache_folder` gives, not yet made."""
    monkeypatch.setenv(cache_dir.VARIABLE, str(surroundings / "named"))
    path = cache_dir.cache_folder()
    cache_dir.shutil.rmtree(path)
    monkeypatch.setattr(cache_dir, "_cached_folder", None)
    return path


@needs_modes
def test_a_folder_into_which_others_could_write_is_made_anew(version):
    plant_an_open_folder(version)
    (version / "thirdbody_law_0.py").write_text("print('not ours')")
    assert cache_dir.cache_folder() == version and mode(version) == 0o700
    assert [path.name for path in version.iterdir()] == [cache_dir.TAG]


@needs_modes
def test_a_link_in_place_of_the_folder_is_replaced(version):
    plant_a_link(version)
    assert cache_dir.cache_folder() == version and not version.is_symlink()


@needs_modes
def test_the_folder_of_another_user_is_refused(version, monkeypatch):
    version.mkdir()
    real = Path.lstat

    def lstat(path):
        found = list(real(path))
        found[stat.ST_UID] = OTHER_USER
        return os.stat_result(found)

    monkeypatch.setattr(Path, "lstat", lstat)
    with pytest.raises(OutputError, match="belongs to another user"):
        cache_dir.cache_folder()


@needs_modes
def test_a_folder_that_lost_its_rights_gets_them_back(version):
    version.mkdir(mode=0o700)
    (version / "kept").write_text("")
    version.chmod(0)
    assert cache_dir.cache_folder() == version and mode(version) == 0o700
    assert (version / "kept").exists()


@pytest.mark.parametrize("spoil", [Path.mkdir, lambda path: path.write_bytes(b"")], ids=["a folder", "an empty file"])
def test_a_damaged_mark_is_written_anew(spoil, version):
    version.mkdir(mode=0o700)
    spoil(version / cache_dir.TAG)
    assert (cache_dir.cache_folder() / cache_dir.TAG).read_bytes() == cache_dir.TAG_TEXT


def test_a_full_disk_is_reported_in_one_line(version, monkeypatch):
    def full(*_arguments, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match="cannot be written .No space left on device.; THIRDBODY_CACHE names") as report:
        cache_dir.cache_folder()
    assert report.value.exit_code == 5 and "\n" not in str(report.value)


# pruning ------------------------------------------------------------------------------------------------------------------


def test_only_folders_that_bear_our_mark_are_deleted(tmp_path):
    theirs = [tmp_path / name for name in ("data", "thesis", "0123456789abcdefg", "0123456789ABCDEF")]
    unmarked = [tmp_path / f"{k:016x}" for k in range(7)]
    other_mark = [tmp_path / f"{k:016x}" for k in range(7, 9)]
    ours = [tmp_path / f"{k:016x}" for k in range(9, 16)]
    for k, folder in enumerate(theirs + unmarked + other_mark + ours):
        folder.mkdir()
        if folder in ours + theirs:
            (folder / cache_dir.TAG).write_bytes(cache_dir.TAG_TEXT)
        if folder in other_mark:
            (folder / cache_dir.TAG).write_bytes(cache_dir.TAG_TEXT.splitlines(keepends=True)[0])
        os.utime(folder, (k, k))
    (tmp_path / f"{16:016x}").symlink_to(ours[0])
    cache_dir._prune(tmp_path)
    assert all(folder.is_dir() for folder in theirs + unmarked + other_mark)
    assert [folder.is_dir() for folder in ours] == [False] * 3 + [True] * cache_dir.MAX_VERSIONS
