"""Folders of runs spoilt at random, put through every command that reads one: told in one message that names the file, with the
exit code of the contract; no traceback, no hang, nothing half-written, and a run that is refused stays as it was."""

import json
import os
import shutil
import sys
from collections import Counter
from random import Random

import pytest
from balls import BALLS, edited
from hard import file_mutants as M
from hard.worker import Worker

import thirdbody
from thirdbody.errors import Interrupted
from thirdbody.runner.simulate import execute, prepare

BATCH, MANY = 12, int(os.environ.get("FUZZ_RUNS", "1000"))
CODES = {0, 2, 3, 4, 5}
"""Done, usage, input, guard, output; anything else is no answer to a spoilt file."""
SCENE = edited(
    BALLS, ("count = 4", "count = 3"), ('"0.1 um"\nsettle = "1 us"', '"0.06 um"\nsettle = "20 ns"'), ("0.05 um", "0.01 um")
)
KINDS = ("explicit", "implicit")


def stopped(kind, folder):
    """The folder of a run that was stopped after some frames, with its checkpoint."""
    frames, changes = [0], {"solver.integrator": kind, "contact.debris_contact": "none"}
    simulation = prepare(thirdbody.Scene.parse(SCENE).with_settings(changes))
    with pytest.raises(Interrupted):
        execute(simulation, folder, report=lambda progress: frames.append(progress.frame), stop=lambda: frames[-1] > 3)
    with thirdbody.open(folder) as run:
        assert run.frames > 2 and run.has_states
    return folder


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    home = tmp_path_factory.mktemp("sound")
    return {kind: stopped(kind, home / kind) for kind in KINDS}


def draws():
    from thirdbody.render.render import LIBRARIES, _loads

    return not sys.platform.startswith("linux") or any(_loads(name) for names in LIBRARIES.values() for name in names)


def asked(worker, *words):
    return worker.request(json.dumps([str(word) for word in words]))


@pytest.fixture(scope="module")
def worker(tmp_path_factory, sound):
    """A worker that has compiled what the sound runs need."""
    home, made = tmp_path_factory.mktemp("first"), Worker(tmp_path_factory.mktemp("cwd"))
    for kind, run in sound.items():
        asked(made, shutil.copytree(run, home / kind), home, "resume")
    yield made
    made.close()


def requested(kind, rng):
    if kind != M.TRAJECTORY:
        return ["resume"]
    drawn = [name for name in M.COMMANDS if name.startswith("render") and "page" not in name] if draws() else []
    found = rng.sample([name for name in M.COMMANDS if name not in drawn and name != "resume"], 3)
    return [*found, *(rng.sample(drawn, 1) if drawn and rng.random() < 0.3 else ()), "resume"]


def bytes_of(folder):
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))}


def faults_of(worker, folder, target, command):
    """Exit code, and what is wrong with the answer to a command on a spoilt run."""
    before = bytes_of(folder)
    target.mkdir()
    code, text = asked(worker, folder, target, command)
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


@pytest.mark.parametrize("count", [BATCH, pytest.param(MANY, marks=pytest.mark.full(kind="fuzz"))])
def test_spoilt_runs_are_reported(worker, sound, tmp_path, count):
    report, bugs = Counter(), []
    for number in range(count):
        rng = Random(number)
        folder = shutil.copytree(sound[KINDS[number % 2]], tmp_path / str(number))
        try:
            kind = M.spoil_folder(folder, rng)
        except (OSError, RuntimeError, KeyError):  # HDF5 refuses what a mutation asks of it
            shutil.rmtree(folder)
            continue
        for command in requested(kind, rng):
            code, wrong = faults_of(worker, folder, tmp_path / "out", command)
            report[code] += 1
            bugs += [f"{number} {kind} {line}" for line in wrong]
        shutil.rmtree(folder)
    assert not bugs, f"{len(bugs)} of {dict(report)}\n" + "\n".join(bugs[:25])
    assert report[3] > count // 3  # else the mutations are too tame to mean anything


@pytest.mark.parametrize("kind", KINDS)
def test_sound_runs_pass_every_command(worker, sound, tmp_path, kind):
    """Else the worker might refuse everything."""
    folder = shutil.copytree(sound[kind], tmp_path / "run")
    (tmp_path / "out").mkdir()
    for command in M.COMMANDS:
        if draws() or not command.startswith("render") or "page" in command:
            code, text = asked(worker, folder, tmp_path / "out", command)
            assert code == 0 or (command == "states picture" and "no body has a forecast" in text), f"{command}: {text}"
    with thirdbody.open(folder) as run:
        assert run.summary()["finished"]
