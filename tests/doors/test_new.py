"""What is installed to start from: the shipped scenes and the plug-in template, from the source tree and from a wheel."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from thirdbody.cli import starter_files
from thirdbody.laws.registry import load_file
from thirdbody.scene.model import Scene

ROOT = Path(__file__).resolve().parents[2]
SCENES = {path.relative_to(ROOT / "scenes").with_suffix("").as_posix(): path for path in (ROOT / "scenes").rglob("*.toml")}


def test_every_shipped_scene_is_listed_with_its_question(command):
    report = command("new", "--list")
    assert report.code == 0
    lines = {line.split()[0]: line for line in report.out.splitlines() if line}
    for name, path in SCENES.items():
        question = path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        assert question in lines[name]
    rows = json.loads(command("new", "--list", "--json").out)
    assert {row["name"] for row in rows} == SCENES.keys() and all("?" in row["question"] for row in rows)


@pytest.mark.parametrize("name", sorted(SCENES))
def test_a_copy_has_all_that_the_scene_needs(name, command, tmp_path):
    report = command("new", "mine.toml", "--from", name)
    assert report.code == 0 and report.out.startswith("mine.toml")
    assert (tmp_path / "mine.toml").read_bytes() == SCENES[name].read_bytes()
    if name.startswith("balance/"):
        assert "next: thirdbody balance mine.toml" in report.out
        return
    if "sweep" in tomllib.loads(SCENES[name].read_text(encoding="utf-8")):
        assert "next: thirdbody sweep --dry-run mine.toml" in report.out
        assert command("sweep", "--dry-run", "mine.toml").code == 0
        return
    assert "next: thirdbody check mine.toml" in report.out
    scene = Scene.load("mine.toml")
    for debris in scene.debris:
        assert not hasattr(debris, "file") or scene.beside(debris.file).is_file()


def test_a_file_that_a_scene_needs_is_copied_once_and_never_over_another(command, tmp_path):
    assert command("new", "--from", "scanned_debris.toml").code == 0
    mesh = tmp_path / "debris_particle.stl"
    assert mesh.read_bytes() == (ROOT / "scenes" / "debris_particle.stl").read_bytes()
    report = command("new", "again.toml", "--from", "scanned_debris")
    assert report.code == 0 and "stl" not in report.out
    mesh.write_bytes(b"my own")
    report = command("new", "third.toml", "--from", "scanned_debris")
    assert report.code == 5 and "debris_particle.stl: exists already" in report.err
    assert mesh.read_bytes() == b"my own" and not (tmp_path / "third.toml").exists()


def test_what_cannot_be_written_leaves_nothing(tmp_path, monkeypatch):
    def full(path: Path, content: bytes) -> None:
        if path.suffix == ".stl":
            raise OSError(28, "No space left on device")
        path.write_bytes(content)

    monkeypatch.setattr(starter_files, "write_whole", full)
    with pytest.raises(starter_files.OutputError, match="debris_particle.stl: cannot be written .No space left"):
        starter_files.copy_scene("scanned_debris", tmp_path / "x.toml")
    assert list(tmp_path.iterdir()) == []


def test_a_plug_in_to_start_from(command, tmp_path):
    report = command("new", "--plugin", "sticky.py")
    assert report.code == 0 and "next: thirdbody laws --check sticky.py" in report.out
    assert (tmp_path / "sticky.py").read_bytes() == (ROOT / "plugins" / "dmt_adhesion.py").read_bytes()
    assert load_file(tmp_path / "sticky.py").effects
    assert command("new", "--plugin", "sticky.py").code == 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--from", "freting"), "--from freting: no such scene, did you mean 'fretting'?"),
        (("--from", "../plugins/x"), "no such scene"),
        (("--from", "fretting", "--plugin"), "give one of them"),
        (("--json",), "only with --list"),
    ],
)
def test_calls_that_cannot_work(arguments, message, command, tmp_path):
    done = command("new", "x.toml", *arguments)
    assert done.code == 2 and message in done.err and done.err.count("\n") == 1 and not list(tmp_path.iterdir())


def test_a_wheel_carries_them_and_no_pictures(tmp_path):
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("src", "plugins", "scenes"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.egg-info", "__pycache__"))
    build = "from setuptools.build_meta import build_wheel; build_wheel('.')"
    subprocess.run([sys.executable, "-c", build], cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"thirdbody_scenes/{name}.toml" for name in SCENES} <= set(names)
    assert {"thirdbody_scenes/debris_particle.stl", "thirdbody_template/dmt_adhesion.py", "thirdbody/__main__.py"} <= set(names)
    assert not [name for name in names if name.endswith((".png", ".ipynb"))]


def test_the_build_asks_for_a_setuptools_that_knows_its_keys():
    """A licence as an SPDX expression is read since setuptools 77.0.3; older ones refuse it."""
    (requested,) = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    assert tuple(map(int, requested.removeprefix("setuptools>=").split("."))) >= (77, 0, 3)
