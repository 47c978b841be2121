"""A run writes its own files and no others: what `--overwrite` replaces and when, and links in a folder that is resumed."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from slow import slow
from steel import STEEL
import thirdbody
from thirdbody.errors import InputError, Interrupted, OutputError
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.run_folder import FILES, REPLACEMENT
from thirdbody.runner.run_loop import WallTimes
from thirdbody.runner.simulate import execute, prepare
from thirdbody.trajectory.writer import TrajectoryWriter

SCENE = STEEL + """\
[[debris]]
kind = "spheres"
material = "steel"
radius = "5 um"
count = 2
[domain]
size = ["40 um", "30 um"]
[plates]
lower = {material = "steel"}
[solver]
duration = "1 us"
[output]
every = "0.5 us"
"""  # fmt: skip


def scene(title):
    return thirdbody.Scene.parse(SCENE).with_settings({"title": title})


def start(folder, title="new", stop=False, **options):
    try:
        execute(prepare(scene(title)), folder, 1, stop=lambda: stop, **options)
    except Interrupted:
        assert stop


def title_of(folder):
    with thirdbody.open(folder) as run:
        return str(run.header["title"])


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("old") / "run"
    start(folder, "old")
    return folder


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cut") / "run"
    start(folder, "old", stop=True)
    return folder


@pytest.fixture
def old(finished, tmp_path):
    return Path(shutil.copytree(finished, tmp_path / "run"))


@pytest.fixture
def cut(interrupted, tmp_path):
    return Path(shutil.copytree(interrupted, tmp_path / "run"))


def check_whole(folder, title):
    assert title_of(folder) == title and {path.name for path in folder.iterdir()} == set(FILES)


def goes_on(folder):
    with thirdbody.resume(folder, progress=False, threads=1) as run:
        assert run.frames == 3 and run.summary()["finished"]


def test_a_run_is_replaced(old):
    check_whole(old, "old")
    start(old, overwrite=True)
    check_whole(old, "new")
    with thirdbody.open(old) as run:
        assert run.summary()["finished"] and run.frames == 3
    assert (old / "scene.toml").read_text() == scene("new").to_toml()


def test_other_files_in_the_folder_are_named_and_stay(old):
    (old / "paper").mkdir()
    (old / "paper" / "draft.tex").write_text("months of work")
    (old / "notes.md").write_text("mine")
    before = contents(old)
    with pytest.raises(OutputError, match=r"holds other files \(notes.md, paper\) and will not be overwritten"):
        thirdbody.run(scene("new"), old, overwrite=True, progress=False)
    assert contents(old) == before


@pytest.mark.parametrize("kind", ["folder", "link"])
def test_what_only_bears_the_name_of_a_file_of_ours_stays(finished, tmp_path, kind):
    (tmp_path / "elsewhere").write_text("mine")
    for name in ("run.spheres.vtkhdf", "scene.toml", REPLACEMENT):
        old = shutil.copytree(finished, tmp_path / f"run {name}")
        (old / name).unlink(missing_ok=True)
        if kind == "link":
            (old / name).symlink_to(tmp_path / "elsewhere")
        else:
            (old / name).mkdir()
            (old / name / "mine.txt").write_text("mine")
        before = contents(old)
        with pytest.raises(OutputError, match=rf"holds other files \({name}\)"):
            start(old, overwrite=True)
        assert contents(old) == before


def test_a_folder_without_a_run_is_not_overwritten(tmp_path):
    for k, names in enumerate((["scene.toml"], ["scene.toml", "notes.md"], ["notes.md"], [".git"])):
        folder = tmp_path / f"{k}"
        folder.mkdir()
        for name in names:
            (folder / name).write_text("mine")
        with pytest.raises(OutputError, match="is not the folder of a run"):
            start(folder, overwrite=True)
        assert sorted(contents(folder)) == sorted(names)


def test_the_current_folder_is_replaced_in_place(old, monkeypatch):
    monkeypatch.chdir(old)
    before = os.stat(".").st_ino
    start(Path("."), overwrite=True)
    assert os.stat(".").st_ino == os.stat(old).st_ino == before
    check_whole(Path("."), "new")
    (old.parent / "link").symlink_to(old)  # and one that a link names
    start(old.parent / "link", "third", overwrite=True)
    assert (old.parent / "link").is_symlink() and title_of(old) == "third"


@pytest.mark.skipif(not sys.platform.startswith("linux") or not shutil.which("mount"), reason="needs mount")
def test_a_folder_where_a_disk_is_mounted_is_replaced_in_place(finished, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=20m", "tmpfs", disk], capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        start(disk, "old", overwrite=True)  # it is empty
        start(disk, "new", overwrite=True)
        assert os.path.ismount(disk)
        check_whole(disk, "new")
    finally:
        subprocess.run(["umount", disk], check=True)


@pytest.mark.parametrize("error", [OutputError("the disk is full"), KeyboardInterrupt()])
def test_the_old_run_stays_until_the_new_one_has_a_frame(old, monkeypatch, error):
    before, seen = contents(old), []

    def fail(*_):
        seen.append({name: data for name, data in contents(old).items() if not name.startswith(REPLACEMENT)})
        raise error

    monkeypatch.setattr(TrajectoryWriter, "append", fail)
    with pytest.raises(type(error)) as report:
        start(old, overwrite=True)
    assert seen == [before] and contents(old) == before and not (old / REPLACEMENT).exists()
    if isinstance(error, OutputError):
        assert str(report.value) == "the disk is full; the run that is there stays as it is"


def test_a_new_run_that_stops_after_its_first_frame_has_replaced_the_old_one(old):
    start(old, overwrite=True, stop=True)
    check_whole(old, "new")
    thirdbody.resume(old, progress=False).close()


def test_a_checkpoint_that_cannot_be_written_names_the_folder_of_the_run(old, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("thirdbody.runner.checkpoint._write_npz", full)
    with pytest.raises(OutputError) as report:
        start(old, overwrite=True)
    assert str(report.value).startswith(f"{old / CHECKPOINT}: cannot be written") and REPLACEMENT not in str(report.value)
    assert title_of(old) == "old"


def test_two_runs_do_not_replace_one_folder_at_once(old, monkeypatch):
    real = TrajectoryWriter.append

    def meanwhile(self, frame):
        with pytest.raises(OutputError, match="another process is writing this run"):
            start(old, "third", overwrite=True)
        real(self, frame)

    simulation = prepare(scene("new"))
    monkeypatch.setattr(TrajectoryWriter, "append", meanwhile)
    execute(simulation, old, 1, overwrite=True)
    assert title_of(old) == "new"


@pytest.mark.parametrize("every, then", [(0.0, "another run"), (1e9, "removed"), slow(1e9, "nothing"), slow(0.0, "removed")])
def test_a_folder_that_is_renamed_while_the_run_writes(finished, tmp_path, every, then):
    """One message; the run can be resumed where it is now, and what came to stand under the old name is left alone."""
    folder, moved = tmp_path / "run", tmp_path / "moved"

    def rename(progress):
        if progress.frame == 2 and not moved.exists():
            folder.rename(moved)
            if then == "another run":
                shutil.copytree(finished, folder)
            if then == "removed":
                shutil.rmtree(moved)
                moved.mkdir()

    with pytest.raises(OutputError, match="run: the folder was moved or removed while the run wrote into it") as report:
        execute(prepare(scene("new")), folder, 1, rename, times=WallTimes(every))
    assert report.value.exit_code == 5 and "\n" not in str(report.value)
    if then == "another run":
        assert contents(folder) == contents(finished)
    else:
        assert not folder.exists()
    if then != "removed":
        goes_on(moved)


KILLED = """\
import os, sys
from pathlib import Path
from hard.killed_run import die_at
import thirdbody
from thirdbody.runner.simulate import execute, prepare
from thirdbody.trajectory.writer import TrajectoryWriter
simulation, calls = prepare(thirdbody.Scene.parse(sys.argv[2])), sys.argv[4:]
die_at(int(sys.argv[3]), [(TrajectoryWriter, "append"), *((os, name) for name in calls)])
execute(simulation, Path(sys.argv[1]), 1, overwrite=True)
"""


def killed(folder, last, *calls):
    command = [sys.executable, "-c", KILLED, str(folder), scene("new").to_toml(), str(last), *calls]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode in (0, -signal.SIGKILL), done.stderr
    return done.returncode != 0


def check_after_a_kill(folder):
    found = title_of(folder)
    with thirdbody.open(folder) as run:
        assert run.frames == 3 if found == "old" else run.frames >= 1
    after = Path(shutil.copytree(folder, folder.with_name(f"{folder.name} resumed")))
    goes_on(after)
    assert found == "old" or title_of(after) == "new"
    assert {path.name for path in after.iterdir()} == set(FILES)
    start(folder, "third", overwrite=True)
    check_whole(folder, "third")
    return found


@pytest.mark.full(kind="hard")
def test_a_kill_at_any_call_leaves_the_old_run_or_the_new_one(finished, tmp_path):
    found = []
    for last in range(1, 60):
        folder = Path(shutil.copytree(finished, tmp_path / str(last)))
        if not killed(folder, last, "replace", "rename", "unlink", "mkdir", "rmdir"):
            break
        found.append(check_after_a_kill(folder))
    assert "old" in found and "new" in found and found == sorted(found, reverse=True)


def test_a_link_in_a_folder_that_is_resumed_is_refused(interrupted, tmp_path):
    for k, name in enumerate((*FILES, f"{CHECKPOINT}.part", "run.vtkhdf.part", f".scene.toml.{os.getpid()}.part")):
        cut, victim = shutil.copytree(interrupted, tmp_path / f"run{k}"), tmp_path / f"victim{k}"
        if (cut / name).exists():
            (cut / name).rename(victim)
        else:
            victim.write_bytes(b"mine")
        (cut / name).symlink_to(victim)
        before = victim.read_bytes()
        with pytest.raises(InputError) as report:
            prepare_resume(cut)
        assert str(report.value) == f"{cut / name}: is a symbolic link; a run goes on only in regular files of its own"
        assert victim.read_bytes() == before and (cut / name).is_symlink()


def test_a_hard_link_is_not_written_through(cut, tmp_path):
    victims = {name: tmp_path / f"victim_{k}" for k, name in enumerate(FILES)}
    for name, victim in victims.items():
        os.link(cut / name, victim)
    before = {name: victim.read_bytes() for name, victim in victims.items()}
    thirdbody.resume(cut, progress=False, threads=1).close()
    assert {name: victim.read_bytes() for name, victim in victims.items()} == before
