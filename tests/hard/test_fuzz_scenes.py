"""Scenes spoilt at random: each is built, or refused with the key at fault; never a traceback, a hang, or a file written."""

import os
import resource
import signal
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hard import mutants as M
from thirdbody.errors import InputError
from thirdbody.runner.simulate import default_folder, prepare
from thirdbody.scene.model import Scene
from thirdbody.schema.read import MAX_BYTES

SECONDS = 90  # of the processor, with what a mutant may have to compile
PATIENCE = 600  # s on the clock, for what waits without working
ADDRESS_SPACE = 12 << 30  # an allocation of 10**12 anything fails here, in the test, and not for want of memory
FEW, MANY = 60, int(os.environ.get("FUZZ_SCENES", "3000"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The working directory, with hostile files; every shipped scene is compiled, so that no mutant is slow for that."""
    path = tmp_path_factory.mktemp("fuzz")
    before = Path.cwd()
    os.chdir(path)
    for name in ("fifo", "fifo.stl", "fifo.csv", "fifo.npz"):
        os.mkfifo(name)
    os.symlink("loop.csv", "loop.csv")
    for name in ("endless.csv", "endless.stl", "endless.npz"):
        with open(name, "wb") as file:
            file.truncate(1 << 40)  # sparse: takes no room
    for name in ("empty.csv", "zero.stl"):
        Path(name).touch()
    for scene in M.SCENES:
        Path("scene.toml").write_text(M.toml_text(M.small(scene)), encoding="utf-8")
        prepare(Scene.load("scene.toml"))
    yield path
    os.chdir(before)


@contextmanager
def bounded():
    """A limit on time, and on memory: compiled code does not hear an alarm, but is over in time."""

    def too_long(*_):
        raise TimeoutError(f"more than {PATIENCE} s of waiting")

    old, begun = resource.getrlimit(resource.RLIMIT_AS), time.process_time()
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, old[1]))
    handler = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, handler)
        resource.setrlimit(resource.RLIMIT_AS, old)
    assert time.process_time() - begun < SECONDS


def check_words(fault: Any) -> None:
    assert str(fault).isprintable() and len(str(fault)) < 2000, fault


def verify(error: InputError, document: Any, file: str) -> None:
    """Every fault names the file and a key, or, of what is no TOML, the line; and it cannot steer a terminal."""
    for fault in error.faults:
        assert fault.file == file, fault
        check_words(fault)
        if document is None:
            said = fault.message
            assert fault.line is not None or f"at most {MAX_BYTES / 1e6:.0f} MB" in said or "nested too deeply" in said, fault
        elif fault.key:
            assert M.names_a_key(fault, document), fault
        else:
            assert "nested too deeply" in fault.message, fault


def build(scene: Scene) -> None:
    assert Scene.parse(scene.to_toml()) == scene
    kept = default_folder(scene)
    assert len(kept.parts) == 2 and kept.parts[0] == "runs" and ".." not in kept.parts
    prepare(scene)


def try_scene(data: bytes, must_fail: bool) -> str:
    before = set(os.listdir())
    Path("scene.toml").write_bytes(data)
    try:
        document = tomllib.loads(data.decode("utf-8-sig")) if len(data) <= MAX_BYTES else None
    except (ValueError, RecursionError):
        document = None
    with bounded():
        try:
            build(Scene.load("scene.toml"))
            report = "accepted"
        except InputError as error:
            verify(error, document, "scene.toml")
            report = "refused"
    assert set(os.listdir()) == before | {"scene.toml"}
    assert report == "refused" or not must_fail, "accepted what is wrong wherever it stands"
    return report


def try_setting(seed: int) -> str:
    rng = Random(seed)
    document = M.small(rng.choice(M.SCENES))
    scene = Scene.parse(M.toml_text(document), "scene.toml")
    key, value = M.setting(document, rng)
    before = set(os.listdir())
    with bounded():
        try:
            build(scene.with_settings({key: value}))
            report = "accepted"
        except InputError as error:
            for fault in error.faults:
                assert fault.key and fault.file in ("with_settings", "scene.toml"), fault
                check_words(fault)
            report = "refused"
    assert set(os.listdir()) == before
    return report


def many(examples: int, attempt: Any) -> None:
    rng, report = Random("mutants"), Counter[str]()  # the same seeds with every version of every library
    for _ in range(examples):
        seed = rng.getrandbits(62)
        try:
            report[attempt(seed)] += 1
        except BaseException as error:
            error.add_note(f"of the seed {seed}")
            raise
    assert report["refused"] > examples // 4 and report["accepted"] > examples // 50  # else the mutations mean nothing


def a_scene(seed: int) -> str:
    return try_scene(*M.mutant(Random(seed)))


FUZZ = pytest.mark.full(kind="fuzz")


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=FUZZ)])
def test_spoilt_scenes_are_refused_by_key(folder, count):
    many(count, a_scene)


@pytest.mark.parametrize("count", [40, pytest.param(MANY // 5, marks=FUZZ)])
def test_spoilt_settings_are_refused_by_key(folder, count):
    many(count, try_setting)


def test_scenes_that_once_showed_a_fault(folder):
    """nan among an effect's options, a length of 4001 digits, sizes without any between min and max, an aspect of 5e-324."""
    for seed in (569582, 2502417, 7705200, 19852946):
        a_scene(seed)


def test_a_scene_that_is_no_file_is_refused_at_once(folder):
    for name in ("scene.toml/..", "/dev/zero", "fifo", "endless.csv", "loop.csv", ".", "a\0b", "x" * 5000):
        with bounded(), pytest.raises(InputError) as report:
            Scene.load(name)
        said = str(report.value)
        assert len(report.value.faults) == 1 and said.isprintable() and name[:50].replace("\0", "\\x00") in said
