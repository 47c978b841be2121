"""A disk that is full, or read-only, while a checkpoint is written and while a run is taken up: one message, exit code 5, what
was written is kept, and once there is room the run goes on to the same bits."""

import errno
import os
import resource
import shutil
import subprocess
import sys
from collections import namedtuple
from contextlib import contextmanager
from pathlib import Path

import pytest
from slow import slow
from steel import SCENES
from trajectories import contents
import thirdbody
from thirdbody.errors import Interrupted, OutputError
from thirdbody.runner import checkpoint
from thirdbody.runner.checkpoint import FILE, read_checkpoint
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.run_loop import WallTimes
from thirdbody.runner.simulate import execute, prepare
from thirdbody.trajectory import writer

SCENE = SCENES / "sheared_debris.toml"
SHORT = {"debris.0.count": "8", "solver.distance": "0.2 um", "output.every": "0.05 um", "solver.settle": "1 us"}
KINDS = {"explicit": {}, "implicit": {"contact.debris_contact": "none", "solver.integrator": "implicit"}}


def scene_of(kind):
    return thirdbody.Scene.load(SCENE).with_settings(SHORT | KINDS[kind])


def names(folder):
    return {path.name for path in folder.iterdir()}


@pytest.fixture(scope="module", params=["explicit", slow("implicit")])
def runs(request, tmp_path_factory):
    home, frames = tmp_path_factory.mktemp(f"disk_{request.param}"), [0]
    execute(prepare(scene_of(request.param)), home / "whole")
    told = {"report": lambda progress: frames.append(progress.frame), "stop": lambda: frames[-1] > 1}
    with pytest.raises(Interrupted):
        execute(prepare(scene_of(request.param)), home / "cut", times=WallTimes(0.0), **told)
    return home / "whole", home / "cut"


@pytest.fixture()
def cut(runs, tmp_path):
    return Path(shutil.copytree(runs[1], tmp_path / "run"))


def take_up(folder, every=0.0):
    simulation, kept = prepare_resume(folder)
    execute(simulation, folder, checkpoint=kept, times=WallTimes(every))


def goes_on(folder, whole, before):
    assert names(folder) == before
    with thirdbody.open(folder) as run:
        assert run.frames >= read_checkpoint(folder).frames > 1
    take_up(folder, 1e9)
    first, second = contents(whole), contents(folder)
    assert [name for name in first if first[name] != second[name]] == []


@contextmanager
def failing(owner, name, after, error):
    real, calls = getattr(owner, name), 0

    def call(*args, **options):
        nonlocal calls
        calls += 1
        if calls > after:
            raise error
        return real(*args, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(owner, name, call)
        yield


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
MORE = (("fsync", 0), ("fsync", 3), ("replace", 0), ("replace", 1), ("replace", 3))


@pytest.mark.parametrize("name, after", [("fsync", 1), *(slow(*row) for row in MORE)])
def test_a_checkpoint_that_cannot_be_written_keeps_the_one_before(runs, cut, name, after):
    """From the copy of the trajectory that a resumed run begins with, to its last checkpoint."""
    before, old = names(cut), read_checkpoint(cut).frames
    with failing(os, name, after, FULL), pytest.raises(OutputError) as report:
        take_up(cut)
    assert report.value.exit_code == 5 and str(report.value).count("\n") == 0
    assert str(cut) in str(report.value) and "No space left" in str(report.value)
    assert read_checkpoint(cut).frames >= old
    goes_on(cut, runs[0], before)


def test_a_checkpoint_cut_short_by_the_disk_is_not_taken_for_one(runs, cut, monkeypatch):
    before, old = names(cut), (cut / FILE).read_bytes()

    def half(file, *_arrays):
        file.write(b"PK" * 1000)
        raise FULL

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "_write_npz", half)
        with pytest.raises(OutputError, match="checkpoint.npz: cannot be written .No space left.*the one before is kept"):
            take_up(cut)
    assert (cut / FILE).read_bytes() == old
    goes_on(cut, runs[0], before)


@contextmanager
def limited(nbytes):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (nbytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("share", [slow(0.01), 0.5, slow(0.99)])
def test_a_disk_that_is_full_for_the_copy_of_the_trajectory(runs, cut, share):
    before, size = names(cut), (cut / "run.vtkhdf").stat().st_size
    with limited(int(share * size)), pytest.raises(OutputError) as report:
        take_up(cut)
    refused(report.value, cut / "run.vtkhdf")
    goes_on(cut, runs[0], before)


def test_a_disk_that_fills_up_under_a_resumed_run(runs, cut, monkeypatch):
    before, requested = names(cut), [0]

    def usage(_path):
        requested[0] += 1
        return namedtuple("usage", "total used free")(10**10, 10**10, 10**10 if requested[0] <= 4 else 1000)

    with monkeypatch.context() as patch:
        patch.setattr(writer.shutil, "disk_usage", usage)
        with pytest.raises(OutputError, match="disk is full") as report:
            take_up(cut)
    refused(report.value, cut / "run.vtkhdf")
    goes_on(cut, runs[0], before)


def refused(error, path):
    text = str(error)
    assert error.exit_code == 5 and "\n" not in text and text.startswith(str(path)) and ".part" not in text
    assert int(text.split(" frames written before are kept")[0].split()[-1]) > 1


@contextmanager
def mounted(folder, size):
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], capture_output=True)
    if made.returncode:
        pytest.skip("no file system can be mounted here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def remount(folder, how):
    subprocess.run(["mount", "-o", f"remount,{how}", str(folder)], check=True)


HARD = pytest.mark.full(kind="hard")
needs_mount = pytest.mark.skipif(not sys.platform.startswith("linux") or not shutil.which("mount"), reason="needs mount")


@needs_mount
@HARD
@pytest.mark.parametrize("room", [4096, 300_000])
def test_a_file_system_without_space(runs, tmp_path, room):
    size = sum(path.stat().st_size for path in runs[1].iterdir())
    with mounted(tmp_path / "small", 2 * size + 10_000_000) as small:
        folder = Path(shutil.copytree(runs[1], small / "run"))
        before, free = names(folder), shutil.disk_usage(small).free
        (small / "ballast").write_bytes(bytes(free - room))
        with pytest.raises(OutputError) as report:
            take_up(folder)
        assert str(report.value).count("\n") == 0 and str(folder) in str(report.value)
        (small / "ballast").unlink()
        goes_on(folder, runs[0], before)


@needs_mount
@pytest.mark.parametrize("room", [slow(8192), 80_000, slow(200_000), 400_000])
def test_a_disk_that_is_full_before_the_first_frame_leaves_nothing(tmp_path, room):
    """Room for a folder, for a part of the file, for all but the checkpoint, and for all but the frame."""
    with mounted(tmp_path / "small", room) as small:
        with pytest.raises(OutputError) as report:
            execute(prepare(scene_of("explicit")), small / "runs" / "one")
        text = str(report.value)
        assert report.value.exit_code == 5 and text.count("\n") == 0 and str(small / "runs" / "one") in text
        assert "are kept" not in text and "is kept" not in text
        assert text.endswith(("no frame was written", "there is none before it"))
        assert list(small.iterdir()) == []


def test_folders_above_a_run_that_could_not_begin_are_removed_only_if_it_made_them(runs, tmp_path):
    """After `runs`, which wrote what the compiler keeps: its files are longer than this limit."""
    (tmp_path / "mine").mkdir()
    with limited(50_000), pytest.raises(OutputError, match="no frame was written"):
        execute(prepare(scene_of("explicit")), tmp_path / "mine" / "runs" / "one")
    assert names(tmp_path) == {"mine"} and names(tmp_path / "mine") == set()


@needs_mount
@HARD
def test_a_read_only_file_system(runs, tmp_path):
    size = sum(path.stat().st_size for path in runs[1].iterdir())
    with mounted(tmp_path / "small", 4 * size + 20_000_000) as small:
        folder = Path(shutil.copytree(runs[1], small / "run"))
        before = names(folder)
        remount(small, "ro")
        with pytest.raises(OutputError, match="Read-only file system") as report:
            take_up(folder)
        refused(report.value, folder / "run.vtkhdf")
        with pytest.raises(OutputError, match="checkpoint.npz.*Read-only.*the one before is kept"):
            checkpoint.write_checkpoint(folder, read_checkpoint(folder))
        remount(small, "rw")
        goes_on(folder, runs[0], before)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the rights of folders do not bind root")
def test_a_folder_without_the_right_to_write(runs, cut):
    before = names(cut)
    cut.chmod(0o555)
    try:
        with pytest.raises(OutputError, match="Permission denied") as report:
            take_up(cut)
        refused(report.value, cut / "run.vtkhdf")
    finally:
        cut.chmod(0o755)
    goes_on(cut, runs[0], before)
