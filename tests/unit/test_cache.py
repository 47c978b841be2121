"""Compiled code: kept only where no other user can write, what may be deleted, damaged files compiled anew without a word."""

import errno
import os
import pwd
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import numba
import pytest
from thirdbody.errors import OutputError
from thirdbody.jit import cache  # what is tested is in place once kernels are imported
from thirdbody.laws import generated
from thirdbody.system import processes

OTHER_USER = 54321


@pytest.fixture
def surroundings(tmp_path, monkeypatch) -> Path:
    """A home, a folder for temporary files, a current folder, and none of the variables."""
    for name in ("home", "temporary", "current"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv(cache.VARIABLE, "")  # restored afterwards, also where the code sets it
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.chdir(tmp_path / "current")
    return tmp_path


@pytest.fixture
def choose(surroundings):
    return cache.cache_folder.__wrapped__  # as a new process does


def owned_by_other(probe):
    def probed(path):
        found = list(probe(path))
        found[stat.ST_UID] = OTHER_USER
        return os.stat_result(found)

    return probed


def mode(path):
    return stat.S_IMODE(path.lstat().st_mode)


def test_a_cache_home_must_be_absolute_and_the_variable_names_the_parent(surroundings, choose, monkeypatch):
    for value in (None, "", "relative/folder"):
        if value is not None:
            monkeypatch.setenv("XDG_CACHE_HOME", value)
        assert choose().parent == surroundings / "home" / ".cache" / "thirdbody"
    assert list((surroundings / "current").iterdir()) == []
    monkeypatch.setenv("XDG_CACHE_HOME", str(surroundings / "caches"))
    assert choose().parent == surroundings / "caches" / "thirdbody"
    monkeypatch.setenv(cache.VARIABLE, "here")
    assert choose().parent == surroundings / "current" / "here"
    (surroundings / "file").write_text("")
    monkeypatch.setenv(cache.VARIABLE, str(surroundings / "file" / "folder"))
    with pytest.raises(OutputError, match="compiled code cannot be written") as report:
        choose()
    assert str(surroundings / "file") in str(report.value) and "\n" not in str(report.value)


def test_without_a_home_compiled_code_goes_to_temporary_files(surroundings, choose, monkeypatch):
    def unknown(_user):
        raise KeyError("no such user")

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    for home in ("", "relative", None):
        monkeypatch.setenv(cache.VARIABLE, "")
        monkeypatch.setenv("HOME", home) if home is not None else monkeypatch.delenv("HOME")
        assert choose().parent.parent == surroundings / "temporary"
    assert list((surroundings / "current").iterdir()) == []


def test_the_folder_in_the_home_is_closed_to_others_and_one_of_another_user_not_used(surroundings, choose, monkeypatch):
    parent = surroundings / "home" / ".cache" / "thirdbody"
    parent.mkdir(parents=True)
    parent.chmod(0o775)
    assert choose().parent == parent and mode(parent) & 0o022 == 0 and mode(choose()) == 0o700
    monkeypatch.setattr(cache, "_probe", owned_by_other(cache._probe))  # as with `sudo`, which may keep HOME
    assert not cache._usable(parent)


def plant_a_link(path: Path) -> None:
    (path.parent / "elsewhere").mkdir(mode=0o700)
    path.symlink_to(path.parent / "elsewhere")


def plant_an_open_folder(path: Path, rights=0o777) -> None:
    path.mkdir()
    path.chmod(rights)


PLANTED = {
    "nothing": None, "a symbolic link": plant_a_link, "a folder that all can write": plant_an_open_folder, "a file": Path.touch,
    "a folder that all can read": lambda path: plant_an_open_folder(path, 0o755),
    "one of another user": lambda path: path.mkdir(0o700),
}  # fmt: skip


@pytest.mark.parametrize("name", PLANTED)
def test_what_is_planted_as_the_folder_among_temporary_files_is_not_used(name, surroundings, choose, monkeypatch):
    """A new folder is taken that only this user can enter, which the processes started by this one find too."""
    (surroundings / "home" / ".cache").write_text("a file where a folder should be")
    if name == "one of another user":  # here this user plants it and another one starts the program
        monkeypatch.setattr(os, "geteuid", lambda: OTHER_USER)
    planted = surroundings / "temporary" / f"thirdbody-{os.geteuid()}"
    if PLANTED[name] is None:
        first = choose()
        assert first.parent == planted and mode(planted) == 0o700 and choose() == first
        return
    PLANTED[name](planted)
    parent = choose().parent
    assert parent != planted and parent.parent == planted.parent and not parent.is_symlink()
    assert mode(parent) == 0o700 and os.environ[cache.VARIABLE] == str(parent)
    assert not planted.is_dir() or list(planted.iterdir()) == []


@pytest.fixture
def version(surroundings, choose, monkeypatch) -> Path:
    monkeypatch.setenv(cache.VARIABLE, str(surroundings / "named"))
    path = choose()
    shutil.rmtree(path)
    return path


def test_a_folder_into_which_others_could_write_and_a_link_are_made_anew(version, choose):
    plant_an_open_folder(version)
    (version / "thirdbody_law_0.py").write_text("print('not ours')")
    assert choose() == version and mode(version) == 0o700 and [path.name for path in version.iterdir()] == [cache.TAG]
    (version / "kept").write_text("")
    version.chmod(0)  # one that lost its rights gets them back
    assert choose() == version and mode(version) == 0o700 and (version / "kept").exists()
    for spoil in (Path.mkdir, Path.touch):  # a damaged mark is written anew
        (version / cache.TAG).unlink()
        spoil(version / cache.TAG)
        assert (choose() / cache.TAG).read_bytes() == cache.TAG_TEXT
    shutil.rmtree(version)
    plant_a_link(version)
    assert choose() == version and not version.is_symlink()


def test_the_folder_of_another_user_is_refused(version, choose, monkeypatch):
    version.mkdir()
    monkeypatch.setattr(Path, "lstat", owned_by_other(Path.lstat))
    with pytest.raises(OutputError, match="belongs to another user"):
        choose()


def test_a_full_disk_is_reported_in_one_line(version, choose, monkeypatch):
    def full(*_arguments, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match="cannot be written .No space left on device.; THIRDBODY_CACHE names") as report:
        choose()
    assert report.value.exit_code == 5 and "\n" not in str(report.value)


def test_only_folders_that_bear_our_mark_are_deleted(tmp_path):
    theirs = [tmp_path / name for name in ("data", "thesis", "0123456789abcdefg", "0123456789ABCDEF")]
    unmarked = [tmp_path / f"{k:016x}" for k in range(7)]
    other_mark = [tmp_path / f"{k:016x}" for k in range(7, 9)]
    ours = [tmp_path / f"{k:016x}" for k in range(9, 16)]
    for k, folder in enumerate(theirs + unmarked + other_mark + ours):
        folder.mkdir()
        if folder in ours + theirs:
            (folder / cache.TAG).write_bytes(cache.TAG_TEXT)
        if folder in other_mark:
            (folder / cache.TAG).write_bytes(cache.TAG_TEXT.splitlines(keepends=True)[0])
        os.utime(folder, (k, k))
    (tmp_path / f"{16:016x}").symlink_to(ours[0])
    cache._prune(tmp_path)
    assert all(folder.is_dir() for folder in theirs + unmarked + other_mark)
    assert [folder.is_dir() for folder in ours] == [False] * 3 + [True] * cache.MAX_VERSIONS


TEXT = "from numba import njit\n@njit('f8(f8)', cache=True)\ndef twice(x):\n    return 2.0 * x\n"
HIT, MISS = 1, 0


@pytest.fixture
def load(tmp_path, monkeypatch):
    (tmp_path / "law.py").write_text(TEXT)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))

    def call():
        twice = processes.import_file("law_with_a_cache", tmp_path / "law.py").twice
        del sys.modules["law_with_a_cache"]
        assert twice(1.5) == 3.0
        return sum(twice.stats.cache_hits.values())

    return call


def alter(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


DAMAGE = {
    "cut short": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]), "altered": alter,
    "zero bytes": lambda path: path.write_bytes(b""), "missing": Path.unlink,
    "a folder": lambda path: (path.unlink(), (path / "inner").mkdir(parents=True)),
}  # fmt: skip


@pytest.mark.parametrize("ending", ["nbi", "nbc"], ids=["index", "code"])
def test_a_whole_cache_is_used_and_a_damaged_file_compiled_anew(ending, load, tmp_path):
    assert [load(), load()] == [MISS, HIT]
    (file,) = (tmp_path / "cache").rglob(f"*.{ending}")
    for name, damage in DAMAGE.items():
        damage(file)
        assert [load(), load()] == [MISS, HIT], name


def test_a_cache_serves_a_source_with_another_time_and_no_other_source(load, tmp_path):
    """As after a copy of both to another machine."""
    assert [load(), load()] == [MISS, HIT]
    os.utime(tmp_path / "law.py", (0, 0))
    assert load() == HIT
    (tmp_path / "law.py").write_text(TEXT + "# another\n")
    cache._digest_of.cache_clear()  # as in a new process
    assert load() == MISS


FUNCTIONS = """
import sys
import numpy as np
from thirdbody.jit import options
from numba import njit

@njit(cache=True)
def table(x): return {"a": x, "b": 2.0}["a"] + len({x, 2.0})
@njit(cache=True)
def matrix(x): return np.linalg.solve(x * np.eye(2), np.ones(2)), np.eye(2) @ np.ones((2, 2)), np.sort(np.ones(3))
@njit(cache=True)
def random(x):
    np.random.seed(3)
    return np.random.gamma(x), np.random.randint(0, 9), (x + 1j) ** 2.5, [x, 2.0]
@njit(cache=True)
def words(x): return "a" + str(int(x)), ("b", x), np.float32(x)
@njit(cache=True)
def plain(x):
    if x < 0.0:
        raise ValueError(str(x))
    return x + np.zeros(3)

function = globals()[sys.argv[1]]
print(function(1.5), [sum(count.values()) for count in (function.stats.cache_hits, function.stats.cache_misses)])
"""


def test_functions_of_plug_ins_are_loaded_without_the_compiler_whatever_they_call(tmp_path):
    """A symbol that compiled code lacks would end the process. Each in two processes: the second has not loaded the compiler."""
    (tmp_path / "functions.py").write_text(FUNCTIONS)
    for name in ("table", "matrix", "random", "words", "plain"):
        command, where = [sys.executable, "functions.py", name], os.environ | {cache.VARIABLE: str(tmp_path / "cache")}
        first, second = (subprocess.check_output(command, cwd=tmp_path, env=where, text=True) for _ in range(2))
        assert first.endswith("[0, 1]\n") and second == first.replace("[0, 1]\n", "[1, 0]\n"), name


def test_a_full_disk_while_compiling_is_reported_in_one_line(load, monkeypatch, tmp_path):
    def full(*_arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch, pytest.raises(OutputError) as report:
        patch.setattr(os, "replace", full)
        load()
    assert report.value.exit_code == 5 and "\n" not in str(report.value)
    assert str(tmp_path / "cache") in str(report.value) and "No space left" in str(report.value)
    assert [load(), load()] == [MISS, HIT]


def test_a_damaged_generated_module_is_written_anew(monkeypatch, tmp_path):
    def value(text):
        module, path = generated.load_module("damaged", text, [])
        del sys.modules[module.__name__]
        return module.value, path

    monkeypatch.setattr(generated.cache, "folder", lambda: tmp_path)
    text = "value = 31 + 11  # as a law\n"
    path = value(text)[1]
    for name, damage in DAMAGE.items():
        damage(path)
        assert value(text) == (42, path), name
        assert path.read_text() == text and [p.name for p in tmp_path.iterdir()] == [path.name]
    monkeypatch.setattr(generated.cache, "folder", lambda: tmp_path / "gone")
    with pytest.raises(OutputError, match="compiled code cannot be written"):
        value("value = 1\n")
