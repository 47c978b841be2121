"""A run of a few frames whose every value tells its frame, so that mixed-up offsets show, and what VTK's own reader sees."""

from pathlib import Path

import numpy as np
import pytest
from thirdbody.trajectory.names import BLOCKS, Frame
from thirdbody.trajectory.writer import TrajectoryWriter

CONTACT_COUNTS = (0, 4, 0, 7, 2)
HEADER = {
    "scene_text": 'scene = 1\ntitle = "three grains, µm"\n', "title": "three grains", "versions": {"thirdbody": "0.1.0"},
    "state_names": ["free", "sticking", "sliding", "rolling"], "reason_names": ["none", "friction_limit"],
    "units": {"time": "s", "upper_force": "N"}, "domain": {"size": [40e-6, 20e-6], "periodic": True},
}  # fmt: skip
CLUMP_OF_SPHERE = np.repeat(np.arange(3), (1, 2, 3))
STATIC = {
    "spheres": {"radius": np.linspace(1e-6, 2e-6, 6), "clump": CLUMP_OF_SPHERE},
    "clumps": {"id": np.arange(3), "mass": np.array([1.0, 2.0, 3.0])},
}


def make_frame(number: int) -> Frame:
    rng = np.random.default_rng(number)
    count = CONTACT_COUNTS[number % len(CONTACT_COUNTS)]
    states = np.array([number % 4, 3, 0], np.uint8)
    plates = np.zeros((8, 3))
    plates[4:] = [number * 1e-6, 0.0, 5e-6]
    return Frame(
        time=number * 1e-6,
        spheres={"points": rng.normal(size=(6, 3)), "velocity": rng.normal(size=(6, 3)), "state": states[CLUMP_OF_SPHERE]},
        clumps={
            "points": rng.normal(size=(3, 3)), "quaternion": rng.normal(size=(3, 4)), "state": states, "state_reason": states % 2,
            "loaded": np.array([True, False, True]),
        },
        contacts={
            "points": rng.normal(size=(count, 3)), "vector": rng.normal(size=(count, 3)), "utilisation": rng.random(count),
            "body": np.arange(count, dtype=np.int64),
        },
        plates={"points": plates},
        series={"time": number * 1e-6, "upper_force": rng.normal(size=3)},
    )  # fmt: skip


def write_frames(path: Path, numbers=range(5), frame=make_frame, header=HEADER, finish: dict | None = None) -> Path:
    with TrajectoryWriter(path, header, STATIC) as writer:
        for number in numbers:
            writer.append(frame(number))
        if finish is not None:
            writer.finish(finish)
    return path


def expected(block: str, number: int, frame=make_frame) -> dict[str, np.ndarray]:
    """Spheres keep float32 but for positions and static arrays."""
    arrays = {**frame(number).block(block), **STATIC.get(block, {})}
    narrow = block == "spheres"
    return {name: np.float32(values) if narrow and name == "velocity" else np.asarray(values) for name, values in arrays.items()}


def vtk_blocks(path: Path, step: int) -> list:
    reader = pytest.importorskip("vtk").vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.SetStep(step)
    reader.Update()
    output = reader.GetOutputDataObject(0)
    return [output] if output.IsA("vtkPolyData") else [output.GetBlock(i) for i in range(output.GetNumberOfBlocks())]


def assert_same_as_vtk(data, block: str, number: int) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    wanted = expected(block, number)
    points, per_cell = wanted.pop("points"), 4 if block == "plates" else 1
    assert data.GetNumberOfPoints() == len(points) and data.GetNumberOfCells() == len(points) // per_cell
    for i in range(data.GetNumberOfCells()):
        ids = data.GetCell(i).GetPointIds()
        assert [ids.GetId(k) for k in range(ids.GetNumberOfIds())] == list(range(i * per_cell, (i + 1) * per_cell))
    if len(points):
        np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), points)
        for name, values in wanted.items():
            np.testing.assert_array_equal(vtk_to_numpy(data.GetPointData().GetArray(name)), values)


def assert_vtk_frame(path: Path, step: int, number: int | None = None) -> None:
    """VTK reads at this step, in every block, frame `number` (the same)."""
    for name, data in zip(BLOCKS, vtk_blocks(path, step), strict=True):
        assert_same_as_vtk(data, name, step if number is None else number)
