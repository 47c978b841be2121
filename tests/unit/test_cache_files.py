"""Damaged files of compiled code: the function is compiled anew without a word, and the next process finds it."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numba
import pytest

from thirdbody.errors import OutputError
from thirdbody.jit import cache_files  # what is tested is in place once kernels are imported
from thirdbody.laws.codegen import module_cache
from thirdbody.system import module_import

TEXT = "from numba import njit\n@njit('f8(f8)', cache=True)\ndef twice(x):\n    return 2.0 * x\n"
HIT, MISS = 1, 0


@pytest.fixture
def load(tmp_path, monkeypatch) -> Callable[[], int]:
    """Imports a compiled function as a new process does, checks what it gives, and tells whether it was found compiled."""
    (tmp_path / "law.py").write_text(TEXT)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))

    def call() -> int:
        twice = module_import.import_file("law_with_a_cache", tmp_path / "law.py").twice
        del sys.modules["law_with_a_cache"]
        assert twice(1.5) == 3.0
        return sum(twice.stats.cache_hits.values())

    return call


def files(tmp_path: Path, ending: str) -> Path:
    (found,) = (tmp_path / "cache").rglob(f"*.{ending}")
    return found


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def alter(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


def replace_by_folder(path: Path) -> None:
    path.unlink()
    (path / "inner").mkdir(parents=True)


DAMAGE = {
    "cut short": cut,
    "altered": alter,
    "garbage": lambda path: path.write_bytes(bytes(range(256)) * 9),
    "zero bytes": lambda path: path.write_bytes(b""),
    "missing": Path.unlink,
    "a folder": replace_by_folder,
}


def test_a_whole_cache_is_used(load):
    assert [load(), load()] == [MISS, HIT]


@pytest.mark.parametrize("ending", ["nbi", "nbc"], ids=["index", "code"])
@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_file_is_compiled_anew(damage, ending, load, tmp_path):
    load()
    damage(files(tmp_path, ending))
    assert [load(), load()] == [MISS, HIT]


@pytest.mark.parametrize("ending", ["nbi", "nbc"], ids=["index", "code"])
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the rights of files do not bind root")
def test_a_file_that_may_not_be_read_is_compiled_anew(ending, load, tmp_path):
    load()
    files(tmp_path, ending).chmod(0)
    assert [load(), load()] == [MISS, HIT]


def test_a_file_in_place_of_a_folder_is_replaced(load, tmp_path):
    load()
    folder = files(tmp_path, "nbi").parent
    shutil.rmtree(folder)
    folder.write_text("")
    assert [load(), load()] == [MISS, HIT]
    assert not (tmp_path / "__pycache__").exists()  # where numba goes by itself


@pytest.mark.parametrize("before", [None, ""], ids=["nothing", "a file"])
def test_processes_that_create_a_folder_at_once_do_not_disturb_each_other(before, monkeypatch, tmp_path):
    """Every order of the file operations of two creators: one pauses before each of its operations while the other does all."""
    for pause in range(4):
        path, calls = tmp_path / f"{before}{pause}" / "folder", count()

        def other_first(method, path=path, calls=calls, pause=pause):
            def call(self, *arguments, **options):
                if next(calls) == pause:
                    cache_files._create_folder(path)
                return method(self, *arguments, **options)

            return call

        path.parent.mkdir()
        if before is not None:
            path.write_text(before)
        with monkeypatch.context() as patch:
            for name in ("mkdir", "unlink", "is_dir"):
                patch.setattr(Path, name, other_first(getattr(Path, name)))
            cache_files._create_folder(path)
        assert path.is_dir()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the rights of folders do not bind root")
def test_a_folder_that_lost_its_rights_gets_them_back(load, tmp_path):
    load()
    files(tmp_path, "nbi").parent.chmod(0)
    assert load() == HIT


def test_a_full_disk_is_reported_in_one_line(load, monkeypatch, tmp_path):
    def full(*_arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch, pytest.raises(OutputError) as report:
        patch.setattr(os, "replace", full)
        load()
    assert report.value.exit_code == 5 and "\n" not in str(report.value)
    assert str(tmp_path / "cache") in str(report.value) and "No space left" in str(report.value)
    assert [load(), load()] == [MISS, HIT]


# generated modules --------------------------------------------------------------------------------------------------------


def generated_value(text: str) -> tuple[int, Path]:
    """The value of a generated module, imported as a new process does."""
    module, path = module_cache.load_module("damaged", text, [])
    del sys.modules[module.__name__]
    return module.value, path


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_generated_module_is_written_anew(damage, monkeypatch, tmp_path):
    monkeypatch.setattr(module_cache.cache_dir, "_folder", tmp_path)
    text = "value = 31 + 11  # as a law\n"
    path = generated_value(text)[1]
    damage(path)
    assert generated_value(text) == (42, path)
    assert path.read_text() == text and [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_generated_module_that_cannot_be_written_is_reported(monkeypatch, tmp_path):
    monkeypatch.setattr(module_cache.cache_dir, "_folder", tmp_path / "gone")
    with pytest.raises(OutputError, match="compiled code cannot be written"):
        generated_value("value = 1\n")


def test_the_command_line_reports_a_cache_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    done = subprocess.run(
        [sys.executable, "-m", "thirdbody", "laws"], capture_output=True, text=True,
        env=os.environ | {"THIRDBODY_CACHE": str(tmp_path / "file")},
    )  # fmt: skip
    assert done.returncode == 5 and done.stderr.count("\n") == 1 and str(tmp_path / "file") in done.stderr
