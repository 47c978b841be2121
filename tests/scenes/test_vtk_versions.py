"""Other readers than ours: the VTK versions of PyPI array for array (an environment each, kept in pytest's cache), and an old
ParaView that draws the PVD files (Debian: `apt-get install paraview xvfb`)."""

import os
import shutil
import subprocess
import sys
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from portable import PATIENCE
from steel import SCENES
from trial_run import write_frames
import thirdbody
from thirdbody.api import Run
from thirdbody.export.paraview import write_sidecars
from thirdbody.export.vtk import export_pvd
from thirdbody.palette import rgb, state_colors
from thirdbody.trajectory.names import BLOCKS

SCENE = SCENES / "sheared_debris.toml"
SHORT = {"debris.0.count": "16", "solver.distance": "0.5 um", "output.every": "0.1 um"}
# Runs where neither h5py nor thirdbody is: what VTK gives, against arrays that were laid down beside the files.
CHECK = r"""
import sys
import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

def blocks(path, step):
    reader = vtk.vtkHDFReader()
    reader.SetFileName(path)
    reader.UpdateInformation()
    reader.SetStep(step)
    reader.Update()
    data = reader.GetOutputDataObject(0)
    return [data] if data.IsA("vtkPolyData") else [data.GetBlock(i) for i in range(data.GetNumberOfBlocks())]

def same(data, wanted, block, place):
    count = len(wanted["position"])
    cells = count // 4 if block == "plates" else count
    assert (data.GetNumberOfPoints(), data.GetNumberOfCells()) == (count, cells), place
    names = [data.GetPointData().GetArrayName(i) for i in range(data.GetPointData().GetNumberOfArrays())]
    if not count and vtk.VTK_VERSION.startswith("9.4."):
        assert names == [], (place, names)  # this version alone leaves out the arrays of a block without points
        return 1
    assert sorted(names) == sorted(set(wanted) - {"position"}), (place, names)
    for name, values in wanted.items():
        array = data.GetPoints().GetData() if name == "position" else data.GetPointData().GetArray(name)
        if name == "position" and not count:
            continue  # no points, no array of them
        got = vtk_to_numpy(array)
        assert got.dtype.itemsize == values.dtype.itemsize and np.array_equal(got, values, equal_nan=True), (place, name)
    return len(wanted)

arrays, frames, names = np.load(sys.argv[1]), int(sys.argv[2]), sys.argv[3].split(",")
compared = 0
for path in sys.argv[4:]:
    for step in range(frames):
        shown = [name for name in names if path.endswith("." + name + ".vtkhdf")] or names
        found = blocks(path, step)
        assert len(found) == len(shown), (path, len(found))
        for name, data in zip(shown, found):
            start = "%s/%d/" % (name, step)
            wanted = {key[len(start):]: arrays[key] for key in arrays.files if key.startswith(start)}
            assert "position" in wanted
            compared += same(data, wanted, name, (path, name, step))
print(vtk.VTK_VERSION, compared)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("versions")


@pytest.fixture(scope="module")
def real(folder) -> Path:
    with thirdbody.run(thirdbody.Scene.load(SCENE).with_settings(SHORT), out=folder / "real", progress=False) as run:
        counts = [run.rows("contacts", number) for number in range(run.frames)]
    assert counts[0] == 0 and len(set(counts)) > 2, "the run must show what the test is about"
    return folder / "real" / "run.vtkhdf"


@pytest.fixture(scope="module")
def made(folder) -> Path:
    path = write_frames(folder / "made.vtkhdf", (0, 1, 2, 5, 8, 9, 10))  # no contacts first, between, in a row and last
    write_sidecars(path)
    return path


def lay_down(run: Run, path: Path) -> Path:
    arrays = {
        f"{block}/{number}/{name}": values
        for block in BLOCKS for number in range(run.frames) for name, values in run.block(block, number).items()
    }  # fmt: skip
    np.savez(path, **arrays)
    return path


def python_with(version: str, cache: Path) -> Path:
    place = cache / f"vtk-{version}"
    python = place / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    done = place / "installed"
    if not done.exists():
        venv.create(place, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "-q", f"vtk=={version}.*", "numpy"], check=True)
        done.touch()
    return python


@pytest.mark.full(kind="vtk")
@pytest.mark.parametrize("which", ["made", "real"])
@pytest.mark.parametrize("version", ["9.4", "9.5", "9.6", "9.7"])
def test_vtk_reads_every_array_of_every_block_and_frame(version, which, request, folder):
    path: Path = request.getfixturevalue(which)
    python = python_with(version, request.config.cache.mkdir("vtk"))
    with thirdbody.open(path) as run:
        laid, frames = lay_down(run, folder / f"{which}.npz"), run.frames
        blocks = [run.block(block, number) for block in BLOCKS for number in range(frames)]
        expected = sum(1 if version == "9.4" and not len(arrays["position"]) else len(arrays) for arrays in blocks)
    files = [path, *(path.with_name(f"{path.stem}.{block}.vtkhdf") for block in BLOCKS)]
    command = [python, "-c", CHECK, laid, str(frames), ",".join(BLOCKS), *files]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    report, compared = done.stdout.split()
    assert report.startswith(version + ".")
    # the run, and once more block by block: nothing was left out
    assert int(compared) == 2 * expected


@contextmanager
def display() -> Iterator[str]:
    """An X server of our own, without resets: ParaView leaves once to look for OpenGL, and aborts if it comes back in a reset."""
    read, write = os.pipe()
    server = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x1024x24", "-noreset"], pass_fds=(write,))
    os.close(write)
    try:
        with os.fdopen(read) as report:
            yield f":{report.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


@pytest.mark.full(kind="paraview")
def test_an_old_paraview_draws_the_pvd_files(real, folder):
    if not shutil.which("pvpython") or not shutil.which("Xvfb"):
        pytest.skip("needs ParaView and Xvfb")
    from matplotlib.image import imread

    with thirdbody.open(real) as run:
        export_pvd(run, folder / "pvd", overwrite=True)
        names, states = run.state_names, run.states[-1]
    picture = folder / "paraview.png"
    command = ["pvpython", str(folder / "pvd" / "open_in_paraview.py"), str(picture)]
    with display() as name:
        environment = os.environ | {"DISPLAY": name}
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, env=environment)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    pixels = imread(picture)[:, : 1600 * 2 // 3, :3]  # without the legend, which has all colours
    for code, color in enumerate(state_colors(names)):
        # Shading keeps the hue, and the upper plate, a quarter opaque, dilutes it: 0.98 is 11 degrees.
        hue = np.array(rgb(color)) / np.linalg.norm(rgb(color))
        size = np.linalg.norm(pixels, axis=2)
        seen = np.count_nonzero((pixels @ hue > 0.98 * size) & (size > 0.2))
        bodies = np.count_nonzero(states == code)
        if names[code] == "free":
            continue  # grey, as the plates are
        # A body of 10 um covers about 25 of these pixels; a state that no body has is the control.
        assert seen >= 5 * bodies if bodies else seen < 5, f"{names[code]}: {bodies} bodies, {seen} pixels"
