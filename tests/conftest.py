"""For all tests: the command line as a user calls it; hypothesis without deadlines, since others may use the cores."""

import fcntl
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
import trimesh
from hypothesis import HealthCheck, settings
from shared_runs import SHARED
import thirdbody

APPROX = pytest.approx


def approx(expected, rel=None, abs=None, nan_ok=False):
    """`pytest.approx` without its absolute tolerance of 1e-12, which accepts any energy of a particle of micrometres."""
    return APPROX(expected, rel if rel is not None or abs is not None else 1e-6, 0.0 if abs is None else abs, nan_ok)


pytest.approx = approx
settings.register_profile("any_machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any_machine")


class Reported(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., Reported]:
    """`thirdbody ARGUMENTS` in this process, in the test's folder."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> Reported:
        from thirdbody.cli.main import main

        monkeypatch.setattr(sys, "argv", ["thirdbody", *map(str, arguments)])
        capsys.readouterr()
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        said = capsys.readouterr()
        return Reported(code, said.out, said.err)

    return call


@pytest.fixture(scope="session")
def shared_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of the run of a scene of `SHARED`, made once by the first process that asks. Tests only read it, or copy it."""
    parallel = "PYTEST_XDIST_WORKER" in os.environ
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if parallel else base) / "shared_runs"
    folder.mkdir(exist_ok=True)

    def of(name: str) -> Path:
        with open(folder / f"{name}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (folder / name).exists():
                thirdbody.run(thirdbody.Scene.parse(SHARED[name]), out=folder / f"{name}.part", progress=False, threads=1).close()
                (folder / f"{name}.part").rename(folder / name)
        return folder / name

    return of


@pytest.fixture
def stone(tmp_path: Path) -> trimesh.Trimesh:
    """An ellipsoid of 5.0, 4.0 and 3.0 half axes, also in the file rock.stl."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=5.0)
    mesh.apply_scale([1.0, 0.8, 0.6])
    mesh.export(tmp_path / "rock.stl")
    return mesh
