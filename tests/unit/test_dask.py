"""Sweeps on Dask: the results of local processes, a fake `sbatch`, one message per fault; `cost --overwrite`."""

import os
import sys
import time
from pathlib import Path

import pytest
from ensembles import scene
import thirdbody
from thirdbody.errors import InputError, MissingLibrary, OutputError, UsageError
from thirdbody.studies import cost_command as command
from thirdbody.studies.copies import StudySource
from thirdbody.studies.cost_command import StudyOptions, cost_command
from thirdbody.studies.folder import new_study_folder
from thirdbody.studies.workers import dask_client

SLOW = pytest.mark.full(kind="slow")  # starts other processes
VARY = [{"pairs.0.friction": 0.1}, {"pairs.0.friction": 0.3, "debris.0.seed": 2}, {"plates.upper.load": "1 kN"}]
SMALL = {"debris.0.count": 2, "debris.0.spheres": [3, 3], "solver.distance": "20 nm", "output.every": "10 nm"}

SBATCH = '#!/bin/sh\ncp "$1" "{folder}/job.sh"\n(. "$1") > "{folder}/job.log" 2>&1 &\n'
SBATCH += 'echo $! > "{folder}/pid"\necho "Submitted batch job 4711"\n'
SCANCEL = '#!/bin/sh\nkill $(cat "{folder}/pid")\n'
CLUSTER = 'slurm = {jobs = 1, queue = "normal", account = "debris", cores = 1, processes = 1, memory = "1 GB", '
CLUSTER += 'walltime = "00:10:00", interface = "lo"}'


@pytest.fixture(scope="module")
def client():
    import distributed

    local = distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)
    with local as cluster, distributed.Client(cluster) as client:
        yield client


def rows(sweep):
    """What a table says of each point but times; NaN is equal to itself as text."""
    told = [{name: repr(value) for name, value in point.results.items() if "time" not in name} for point in sweep.points]
    return [(point.status, point.exit_code, row) for point, row in zip(sweep.points, told, strict=True)]


@SLOW
def test_sweep_on_dask_has_the_table_of_local_processes(client, tmp_path):
    base = scene(**SMALL)
    local = thirdbody.sweep(base, VARY, tmp_path / "local", progress=False)
    there = thirdbody.sweep(base, VARY, tmp_path / "dask", executor=client, progress=False)
    assert rows(local) == rows(there) and [point.status for point in there.points] == ["done", "done", "failed"]


@SLOW
def test_fake_slurm_runs_a_sweep(tmp_path, monkeypatch):
    """The job script asks for what the file says and starts a worker of this Python; the job ends with the sweep."""
    commands = tmp_path / "bin"
    commands.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (commands / name).write_text(text.format(folder=tmp_path))
        (commands / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{commands}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cluster.toml").write_text(CLUSTER)
    with dask_client(None, tmp_path / "cluster.toml") as client:
        sweep = thirdbody.sweep(scene(**SMALL), {"debris.0.seed": [1, 2]}, tmp_path / "sweep", executor=client, progress=False)
    assert [point.status for point in sweep.points] == ["done", "done"]
    script = (tmp_path / "job.sh").read_text()
    for line in ("#SBATCH -p normal", "#SBATCH -A debris", "#SBATCH --cpus-per-task=1", "#SBATCH -t 00:10:00"):
        assert line in script
    assert f"{sys.executable} -m distributed.cli.dask_worker tcp://" in script and "--nthreads 1" in script


FAULTS = {
    "[slrum]\ncores = 1\n": ["slrum: is no queue, did you mean 'slurm'?"],
    "[slurm]\nqueu = 'a'\nmemry = '1 GB'\n": ["slurm.queu: is no argument", "did you mean 'queue'?", "did you mean 'memory'?"],
    "[slurm]\njobs = 0\n": ["slurm.jobs: 0 must be a whole number of at least 1"],
    "[slurm]\n[pbs]\n": ["needs one table, such as [slurm]; it has 2"], "[slurm\n": ["cannot be read"],
    "[slurm]\ncores = 1\n": ["slurm: the cluster cannot be started"],
}  # fmt: skip


def test_faults_of_a_cluster_file_come_in_one_message(tmp_path):
    path = tmp_path / "cluster.toml"
    for text, messages in FAULTS.items():
        path.write_text(text)
        with pytest.raises(InputError) as refused, dask_client(None, path):
            pass
        assert all(message in str(refused.value) and str(path) in str(refused.value) for message in messages)


@SLOW
@pytest.mark.parametrize(
    ("sbatch", "words"), [("", "'sbatch'"), ("#!/bin/sh\necho no such account >&2\nexit 1\n", "no such account")]
)
def test_a_queue_that_is_not_there_or_takes_no_job_is_one_message(sbatch, words, tmp_path, monkeypatch, capfd):
    (tmp_path / "cluster.toml").write_text(CLUSTER)
    (tmp_path / "sbatch").write_text(sbatch)
    (tmp_path / "sbatch").chmod(0o755 if sbatch else 0o600)
    monkeypatch.setenv("PATH", str(tmp_path))
    refused = pytest.raises(InputError, match=f"slurm: no job can be submitted: .*{words}")
    with refused, dask_client(None, tmp_path / "cluster.toml"):
        pass
    assert capfd.readouterr().err == ""


@SLOW
def test_address_that_nobody_answers_is_one_message_within_seconds():
    began = time.monotonic()
    refused = pytest.raises(UsageError, match="--dask tcp://127.0.0.1:9: no scheduler answers there")
    with refused, dask_client("tcp://127.0.0.1:9", None):
        pass
    assert time.monotonic() - began < 30.0  # 4 s, and the import of Dask on a busy machine


def test_without_dask_the_message_names_the_extra_and_address_and_file_together_are_refused(monkeypatch):
    with pytest.raises(UsageError, match="not both"), dask_client("tcp://127.0.0.1:9", Path("cluster.toml")):
        pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingLibrary, match=r"thirdbody\[cluster\]"), dask_client("tcp://127.0.0.1:9", None):
        pass


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
