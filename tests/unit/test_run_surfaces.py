"""Surfaces of rough plates in the file of a run, in pyvista, and in pictures."""

import h5py
import numpy as np
import pytest
from layer import AMPLITUDE, wavy_surfaces, write_layer
from thirdbody.api import open_run
from thirdbody.errors import InputError
from thirdbody.render.picture_data import read_picture_data
from thirdbody.render.surfaces import SHADE, skirt, window_mesh
from thirdbody.trajectory.writer import TrajectoryWriter

COUNT = 12


@pytest.fixture(scope="module")
def surfaces():
    return wavy_surfaces(COUNT)


@pytest.fixture(scope="module")
def rough(surfaces, tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("rough") / "run.vtkhdf", COUNT, surfaces=surfaces)


def assert_same(stored, given):
    assert stored.keys() == given.keys()
    for side, surface in given.items():
        np.testing.assert_array_equal(stored[side].heights, surface.heights)
        for name in ("size", "shortest", "curvature", "copies"):
            assert getattr(stored[side], name) == getattr(surface, name), name


def test_a_run_stores_its_surfaces_once_and_gives_them_back(rough, surfaces, tmp_path):
    with open_run(rough) as run:
        assert_same(run.surfaces, surfaces)
        assert run.surface("lower") is run.surfaces["lower"]
        with pytest.raises(ValueError, match="'middle' is not one of 'lower', 'upper'"):
            run.surface("middle")
    path = tmp_path / "run.vtkhdf"
    path.write_bytes(rough.read_bytes())
    with TrajectoryWriter.resume(path, 1), open_run(path) as run:
        assert run.frames == 1
        assert_same(run.surfaces, surfaces)
    # a run between flat plates has no trace of them
    with open_run(write_layer(tmp_path / "flat.vtkhdf", COUNT)) as run:
        assert run.surfaces == {} and run.surface("lower") is None
        assert run.to_pyvista().keys() == ["spheres", "clumps", "contacts", "plates"]
    with h5py.File(tmp_path / "flat.vtkhdf") as file:
        assert "surfaces" not in file


def test_a_damaged_surface_is_one_clear_fault(rough, tmp_path):
    def huge(file):
        del file["surfaces/lower"]
        data = file["surfaces"].create_dataset("lower", (10**6, 10**6), np.float64, chunks=(1000, 1000))
        data.attrs.update({"size": np.ones(2), "copies": np.ones(2), "shortest": 1.0, "curvature": 1})

    path = tmp_path / "run.vtkhdf"
    for spoil in (
        lambda file: file["surfaces"].move("lower", "middle"),
        lambda file: file["surfaces/lower"].attrs.update({"size": np.array([1.0, np.nan])}),
        lambda file: file["surfaces/lower"].attrs.pop("copies"),
        huge,
    ):
        path.write_bytes(rough.read_bytes())
        with h5py.File(path, "r+") as file:
            spoil(file)
        with pytest.raises(InputError, match="not a run of thirdbody, or damaged"):
            open_run(path)


def test_pyvista_gets_the_surfaces_where_the_plates_are(rough, surfaces):
    with open_run(rough) as run:
        blocks, corner = run.to_pyvista(-1), run.plates(-1)["position"][4]
    upper, surface = blocks["upper_surface"], surfaces["upper"]
    assert upper.field_data["height_units"][0] == "m"
    x, z, height = upper.points[:, 0], upper.points[:, 2], upper["height"]
    expected = AMPLITUDE * np.cos(4.0 * np.pi * (x - corner[0]) / surface.size[0])
    np.testing.assert_allclose(height, expected, atol=1e-12 * AMPLITUDE)
    np.testing.assert_allclose(z, corner[2] - expected, rtol=1e-12)  # it looks down
    assert np.ptp(x) == pytest.approx(surface.size[0], rel=1e-12)
    assert blocks["lower_surface"].n_points == 65 * 97
    # a drawn surface is the spline moved with its plate
    with open_run(rough) as run:
        first, data = (read_picture_data(run, frame, "state") for frame in (0, -1))
    # the upper plate is drawn clear of the bodies
    plane, over = first.plate_height_over(first.low, first.high), first.surfaces["upper"].heights(*first.centers.T[:2])
    assert np.all(first.centers[:, 2] + first.radii <= plane - over + 1e-15)
    lower, upper = data.surfaces["lower"], data.surfaces["upper"]
    x = upper.position[0] + surfaces["upper"].spacing[0] * np.arange(48)
    np.testing.assert_allclose(upper.heights(x, 0.0 * x), surfaces["upper"].heights[0], atol=1e-12 * AMPLITUDE)
    mesh = window_mesh(lower, data.low, data.high, data.centers, data.radii)
    points, colors = np.asarray(mesh.points)[::31], mesh.point_data["color"][::31].astype(float).sum(axis=1)
    # heights of the formula; the spline of 32 points a wave differs by (2 pi/32)^4/384 of the amplitude
    wave = AMPLITUDE * np.cos(2.0 * np.pi * (3 * points[:, 0] / lower.size[0] + points[:, 1] / lower.size[1]) - 0.3)
    np.testing.assert_allclose(points[:, 2], wave, atol=1e-4 * AMPLITUDE)
    distance = np.hypot(*(points[:, None, :2] - data.centers[None, :, :2]).transpose(2, 0, 1)) / data.radii
    covered, free = (distance < 0.99).any(axis=1), (distance > 1.01).all(axis=1)
    assert np.corrcoef(colors[free], wave[free])[0, 1] > 0.99  # lighter where it is higher
    level = np.abs(wave) < 0.02 * AMPLITUDE
    assert colors[level & covered].mean() == pytest.approx((1.0 - SHADE) * colors[level & free].mean(), rel=0.02)
    walls = skirt(mesh, -1e-5)
    assert walls.bounds[4] == pytest.approx(-1e-5) and walls.n_cells == 2 * (mesh.dimensions[0] + mesh.dimensions[1]) - 4
