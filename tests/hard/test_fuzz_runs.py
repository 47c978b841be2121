"""Folders of runs spoilt at random, put through every command that reads one: told in one message that names the file, with the
exit code of the contract; no traceback, no hang, nothing half-written, and a run that is refused stays as it was."""

from __future__ import annotations

import importlib.util
import json
import os
import select
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from random import Random
from types import ModuleType

import pytest
from portable import PATIENCE
from steel import STEEL

import thirdbody
from thirdbody.errors import Interrupted
from thirdbody.runner.simulate import execute, prepare

HERE = Path(__file__).parent
SECONDS = 30.0  # of the processor
BATCH, MANY = 12, int(os.environ.get("FUZZ_RUNS", "1000"))
CODES = {0, 2, 3, 4, 5}
"""Done, usage, input, guard, output; anything else is no answer to a spoilt file."""


def loaded(name: str) -> ModuleType:
    """A module of this folder, which is no package."""
    spec = importlib.util.spec_from_file_location(f"thirdbody_test_{name}", HERE / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


F, M = loaded("file_mutants"), loaded("run_mutants")

SCENE = (
    STEEL
    + """\
[[debris]]
kind = "spheres"
material = "steel"
radius = "5 um"
count = 3
[contact]
debris_contact = "none"
[domain]
size = ["80 um", "60 um"]
[plates]
lower = {{material = "steel"}}
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
damping = "7e-5 kg/s"
motion = {{x = {{velocity = "0.5 m/s"}}}}
[solver]
distance = "0.06 um"
settle = "20 ns"
integrator = "{}"
[output]
every = "0.01 um"
"""
)
KINDS = ("explicit", "implicit")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A run by each integrator that was stopped after some frames, with its checkpoint."""
    home, found = tmp_path_factory.mktemp("sound"), {}
    for kind in KINDS:
        frames = [0]
        with pytest.raises(Interrupted):
            execute(
                prepare(thirdbody.Scene.parse(SCENE.format(kind))), home / kind,
                report=lambda progress, frames=frames: frames.append(progress.frame),  # type: ignore[misc]
                stop=lambda frames=frames: frames[-1] > 3,  # type: ignore[misc]
            )  # fmt: skip
        with thirdbody.open(home / kind) as run:
            assert run.frames > 2 and run.has_states
        found[kind] = home / kind
    return found


class Worker:
    """The process that runs the commands, started again after it died."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.process: subprocess.Popen[str] | None = None

    def request(self, *words: str) -> tuple[int | None, str]:
        """Exit code of a command, None for a crash or a hang, and what was said."""
        if self.process is None:
            command = [sys.executable, "-W", "ignore", str(HERE / "run_mutants.py")]
            quiet = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            self.process = subprocess.Popen(command, cwd=self.folder, text=True, **quiet)  # type: ignore[call-overload]
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(json.dumps(words) + "\n")
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        line = self.process.stdout.readline() if ready else ""
        if line:
            code, text, seconds = json.loads(line)
            return (code, text) if seconds < SECONDS else (None, f"{seconds:.0f} s")
        self.close()
        return None, "the worker died" if ready else f"more than {PATIENCE:g} s"

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None


def draws() -> bool:
    """Whether pictures can be drawn here."""
    from thirdbody.render.render import LIBRARIES, _loads

    return not sys.platform.startswith("linux") or any(_loads(name) for names in LIBRARIES.values() for name in names)


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory, sound: dict[str, Path]) -> Iterator[Worker]:
    """A worker that has compiled what the sound runs need; its folder shows whether anything was written."""
    folder, home = tmp_path_factory.mktemp("cwd"), tmp_path_factory.mktemp("first")
    made = Worker(folder)
    for kind, run in sound.items():
        M.copied(run, home / kind)
        made.request(str(home / kind), str(home), "resume")
    yield made
    made.close()
    assert not list(folder.iterdir())


def requested(kind: str, rng: Random) -> list[str]:
    """The commands to put a folder through in which this file is spoilt."""
    if kind != M.TRAJECTORY:
        return ["resume"]
    drawn = [name for name in M.COMMANDS if name.startswith("render") and "page" not in name] if draws() else []
    found = rng.sample([name for name in M.COMMANDS if name not in drawn and name != "resume"], 3)
    return [*found, *(rng.sample(drawn, 1) if drawn and rng.random() < 0.3 else ()), "resume"]


def bytes_of(folder: Path) -> dict[str, bytes | None]:
    """All that is in a folder; None for what is no readable file."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))}


def faults_of(worker: Worker, folder: Path, target: Path, command: str) -> tuple[int | None, list[str]]:
    """Exit code, and what is wrong with the answer to a command on a spoilt run."""
    before = bytes_of(folder)
    target.mkdir()
    code, text = worker.request(str(folder), str(target), command)
    after, wrong = bytes_of(folder), []
    if code not in CODES:
        wrong.append(f"ended with {code}: {text[-1500:]}")
    lines = text.splitlines()
    # what differs from the scene or the laws is told line by line below the folder's name
    places = lines[:1] if lines and "cannot go on" in lines[0] else lines
    if code in (2, 3, 5) and not (lines and all(map(str.isprintable, lines)) and all(str(folder) in line for line in places)):
        wrong.append(f"told without its place: {text[:1500]}")
    if (command != "resume" or code in (2, 3)) and after != before:
        changed = [name for name in before.keys() | after.keys() if before.get(name, 0) != after.get(name, 0)]
        wrong.append(f"refused ({text[:300]}), but changed {changed}")
    if command == "resume" and code in (0, 4):
        try:
            thirdbody.open(folder).close()
        except Exception as error:
            wrong.append(f"left no sound run: {error}")
    here = sorted(path.name for path in target.iterdir())
    if (code and here) or any(name.startswith(".") or name.endswith(".part") for name in here):
        wrong.append(f"left {here}")
    if any(".part" in name for name in after.keys() - before.keys()):
        wrong.append(f"left {sorted(after.keys() - before.keys())}")
    shutil.rmtree(target)
    return code, [f"{command}: {line}" for line in wrong]


def fuzz(worker: Worker, sound: dict[str, Path], tmp_path: Path, numbers: Iterable[int]) -> Counter[int | None]:
    """Every spoilt folder through some commands; how often which code came."""
    report: Counter[int | None] = Counter()
    bugs: list[str] = []
    for number in numbers:
        rng = Random(number)
        folder = M.copied(sound[KINDS[number % 2]], tmp_path / str(number))
        try:
            kind = M.spoil_folder(folder, rng, F)
        except (OSError, RuntimeError, KeyError):  # HDF5 refuses what a mutation asks of it
            shutil.rmtree(folder)
            continue
        for command in requested(kind, rng):
            code, wrong = faults_of(worker, folder, tmp_path / "out", command)
            report[code] += 1
            bugs += [f"{number} {kind} {line}" for line in wrong]
        shutil.rmtree(folder)
    print(dict(report))
    assert not bugs, f"{len(bugs)} of {dict(report)}\n" + "\n".join(bugs[:25])
    return report


def test_spoilt_runs_are_reported(worker: Worker, sound: dict[str, Path], tmp_path: Path) -> None:
    report = fuzz(worker, sound, tmp_path, range(BATCH))
    assert report[3] > BATCH // 3  # else the mutations are too tame to mean anything


@pytest.mark.full(kind="fuzz")
def test_a_thousand_spoilt_runs_are_reported(worker: Worker, sound: dict[str, Path], tmp_path: Path) -> None:
    report = fuzz(worker, sound, tmp_path, range(MANY))
    assert report[3] > MANY // 3


@pytest.mark.parametrize("kind", KINDS)
def test_sound_runs_pass_every_command(worker: Worker, sound: dict[str, Path], tmp_path: Path, kind: str) -> None:
    """Else the worker might refuse everything."""
    folder = M.copied(sound[kind], tmp_path / "run")
    (tmp_path / "out").mkdir()
    for command in M.COMMANDS:
        if draws() or not command.startswith("render") or "page" in command:
            code, text = worker.request(str(folder), str(tmp_path / "out"), command)
            assert code == 0 or (command == "states picture" and "no body has a forecast" in text), f"{command}: {text}"
    with thirdbody.open(folder) as run:
        assert run.summary()["finished"]
