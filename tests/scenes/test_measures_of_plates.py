"""Sums of measures where contacts are of another kind: rough plates, a plate that bodies carry together, spots that flow."""

from __future__ import annotations

import numpy as np
import pytest
from balls import PLATES, edited
from steel import STEEL

import thirdbody

SCENE = (
    edited(STEEL, ('"7850 kg/m3"\n', '"7850 kg/m3"\nyield_strength = "0.4 GPa"\n'))
    + """\
[[debris]]
material = "steel"
kind = "spheres"
shape = [
  {center = ["0 um", "0 um", "0 um"], radius = "2 um"},
  {center = ["3 um", "0 um", "0 um"], radius = "2 um"},
  {center = ["-1.5 um", "2.6 um", "0 um"], radius = "2 um"},
  {center = ["-1.5 um", "-2.6 um", "0 um"], radius = "2 um"},
]
positions = [["10 um", "10 um", "2 um"], ["25 um", "20 um", "2 um"]]
[domain]
size = ["40 um", "20 um"]
"""
    + PLATES
    + """\
[contact]
debris_contact = "none"
[measures]
cell = "0.5 um"
wear = {law = "LAW", plates = "3e-15 m3/J", bodies = "5e-15 m3/J"}
[solver]
integrator = "INTEGRATOR"
settle = "0.1 us"
distance = "0.1 um"
[output]
every = "0.05 um"
"""
)
SURFACE = {"rms": "20 nm", "long": "20 um", "short": "5 um", "seed": 3}
KINDS = {
    "rough": {
        "plates.lower.surface": SURFACE, "plates.upper.surface": SURFACE | {"seed": 4},
        "debris.0.positions": [["10 um", "10 um", "2.05 um"], ["25 um", "20 um", "2.05 um"]],
    },
    "common": {"plates.upper.support": "rigid", "plates.upper.load": "0.2 mN"},
    "plastic": {"effects.elastic_plastic": {}},
}  # fmt: skip
CASES = [(kind, integrator) for kind in KINDS for integrator in ("explicit", "implicit")]


@pytest.fixture(scope="module", params=CASES, ids=" ".join)
def run(request, tmp_path_factory):
    kind, integrator = request.param
    law = "archard" if kind == "common" else "energy"
    scene = thirdbody.Scene.parse(SCENE.replace("LAW", law).replace("INTEGRATOR", integrator)).with_settings(KINDS[kind])
    return kind, thirdbody.run(scene, out=tmp_path_factory.mktemp("run") / kind, threads=1, progress=False)


def on_plates(bodies: dict[str, np.ndarray], name: str) -> np.ndarray:
    return bodies[f"{name}_lower"] + bodies[f"{name}_upper"]


def test_work_of_contacts_is_the_friction_work(run):
    """The same numbers summed in another order; what flow takes is no friction, and wears nothing by energy."""
    kind, of = run
    bodies = of.bodies(-1)
    assert np.all(bodies["friction_work"] > 0.0)
    assert on_plates(bodies, "sliding_work") == pytest.approx(bodies["friction_work"], rel=1e-11)
    if kind == "plastic":
        assert np.all(bodies["plastic_work"] > 1e-3 * bodies["friction_work"])
    if kind != "common":
        assert on_plates(bodies, "plate_wear") == pytest.approx(3e-15 * bodies["friction_work"], rel=1e-11)
        assert bodies["worn_volume"] == pytest.approx(5e-15 * bodies["friction_work"], rel=1e-11)


def test_bodies_under_a_common_plate_wear_its_load_times_the_path(run):
    """Archard's sum over both plates and all bodies is k N s of the last interval, however they share the load."""
    kind, of = run
    if kind != "common":
        pytest.skip("each body has a load of its own")
    worn = [on_plates(of.bodies(frame), "plate_wear").sum() for frame in (-2, -1)]
    path = of.series["distance"][-1] - of.series["distance"][-2]
    assert worn[1] - worn[0] == pytest.approx(3e-15 * 2e-4 * path, rel=3e-3)


def test_maps_add_up_to_the_bodies(run):
    _, of = run
    bodies, area = of.bodies(-1), 0.5e-6 * 0.5e-6
    for plate in ("lower", "upper"):
        maps = of.maps(plate, -1)
        assert maps["wear_depth"].shape == (40, 80)
        for name, amount in (("wear_depth", "plate_wear"), ("friction_work_density", "sliding_work")):
            assert maps[name].sum() * area == pytest.approx(bodies[f"{amount}_{plate}"].sum(), rel=1e-12)
