"""A bed in plane shear: profiles against the forces of the plates and the motion of the bodies; velocity accommodation."""

import numpy as np
import pytest
from steel import SCENES
import thirdbody
from thirdbody.trajectory.names import ACCOMMODATION

SCENE = SCENES / "dense_layer.toml"
SMALL = {
    "debris.0.count": 150, "domain.size": ["60 um", "50 um"], "solver.distance": "12 um", "output.every": "0.4 um",
    "output.profiles": 20, "plates.upper.motion.x.velocity": "2 m/s", "solver.inertial_number": None,
}  # fmt: skip
V = 2.0  # m/s
pytestmark = pytest.mark.full(kind="slow")


@pytest.fixture(scope="module")
def bed(tmp_path_factory):
    scene = thirdbody.Scene.load(SCENE).with_settings(SMALL)
    with thirdbody.run(scene, out=tmp_path_factory.mktemp("bed") / "run", progress=False) as run:
        yield run


def late_mean(run, values):
    return values[run.drag.second_half].mean(axis=0)


def test_the_stress_in_every_slab_is_the_force_of_the_plates(bed):
    """Within 1 %: the momentum of the bed changes by less than that of the forces times the time."""
    stress = late_mean(bed, bed.profiles["contact_stress"] + bed.profiles["kinetic_stress"])
    force = late_mean(bed, bed.series["upper_force"] - bed.series["lower_force"]) / 2.0
    area = np.prod(bed.header["domain"]["size"])
    across = stress[:, :, 2] * area  # forces x, y, z of what is below each slab on what is above
    assert across[:, 2] == pytest.approx(force[2], rel=0.01)
    assert across[:, 0] == pytest.approx(force[0], abs=0.01 * force[2])
    # each plate alone, at its own end: exact but for the samples of the interval
    assert across[-1, [0, 2]] == pytest.approx(late_mean(bed, bed.series["upper_force"])[[0, 2]], rel=0.005)
    assert across[0, [0, 2]] == pytest.approx(-late_mean(bed, bed.series["lower_force"])[[0, 2]], rel=0.005)


def test_slabs_have_the_velocities_of_their_bodies_and_a_bed_is_mostly_sheared(bed):
    solid, velocity = bed.profiles["solid_fraction"], bed.profiles["velocity"][:, :, 0]
    slabs = np.sum(solid * velocity, axis=1) / np.sum(solid, axis=1)
    frames = [bed.bodies(k) for k in range(bed.frames)]
    moved = np.diff([arrays["position"][:, 0] for arrays in frames], axis=0)
    length, time = bed.header["domain"]["size"][0], np.diff(bed.series["time"])
    moved -= length * np.round(moved / length)  # over the edge of the domain
    bodies = np.concatenate([[np.nan], np.average(moved, axis=1, weights=frames[0]["mass"]) / time])
    # samples of the interval against the way of the bodies in it
    assert late_mean(bed, slabs) == pytest.approx(late_mean(bed, bodies), rel=0.01)
    clumps = np.average(solid, axis=1) * late_mean(bed, bed.series["gap"]) * np.prod(bed.header["domain"]["size"])
    assert clumps[-1] == pytest.approx(frames[-1]["mass"].sum() / 7850.0, rel=0.01)  # the gap changes by less
    v = late_mean(bed, velocity)
    assert 0.0 < v[0] and (np.diff(v) > 0.0).mean() > 0.9 and v[-1] < V
    total = sum(bed.series[name] for name in ACCOMMODATION)
    # the first interval of the drag has part of the settling
    assert total[bed.drag.second_half] == pytest.approx(V, rel=1e-9)
    parts = bed.summary()["accommodation"]
    assert parts["shear"] > 0.5 and parts["shear"] == max(parts.values()) and sum(parts.values()) == pytest.approx(1.0)
