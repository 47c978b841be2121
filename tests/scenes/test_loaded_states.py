"""A ball that bounces: states agree with the forces of contacts, and energy goes where it belongs."""

from __future__ import annotations

import numpy as np
import pytest

import thirdbody

SCENE = """
scene = 1
title = "a ball that bounces off a plate"
[materials.steel]
youngs_modulus = "210 GPa"
poisson_ratio = 0.3
density = "7850 kg/m3"
[[pairs]]
between = ["steel", "steel"]
friction = 0.3
restitution = 0.1
[[debris]]
material = "steel"
kind = "spheres"
shape = [{center = ["0 m", "0 m", "0 m"], radius = "5 um"}]
positions = [["20 um", "20 um", "5.001 um"]]
velocity = ["0.1 m/s", "0 m/s", "-1 m/s"]
[domain]
size = ["40 um", "40 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "rigid"
gap = "12 um"
[contact]
law = "three_spot"
level = "mindlin"
debris_contact = "none"
[solver]
duration = "40 ns"
[output]
every = "0.2 ns"
"""


@pytest.fixture(scope="module", params=["explicit", "implicit"])
def bounced(request, tmp_path_factory):
    """The run of the ball by either integrator."""
    folder = tmp_path_factory.mktemp(request.param)
    path = folder / "scene.toml"
    path.write_text(SCENE)
    scene = thirdbody.Scene.load(path).with_settings({"solver.integrator": request.param})
    with thirdbody.run(scene, out=folder / "run", threads=1, progress=False) as run:
        yield run


def test_a_contact_without_force_is_no_loaded_spot(bounced):
    """While the ball leaves, its dashpot cancels the elastic force although the surfaces still overlap: rule 1, `free`."""
    run = bounced
    force = [run.contacts(frame)["normal_force"] for frame in range(len(run.times))]
    touching = np.array([len(forces) > 0 for forces in force])
    loaded = np.array([np.any(forces != 0.0) for forces in force])
    assert (touching & ~loaded).any() and loaded.any(), "the scene must show both kinds of contact"
    assert ((run.states[:, 0] != 0) == loaded).all()
    assert (run.series["loaded"] == loaded).all()


@pytest.mark.parametrize("friction", ["1000.0", "0.3"])
@pytest.mark.parametrize(("tolerance", "most"), [("1e-6", 4e-3), ("1e-7", 1.5e-3)])
def test_the_implicit_integrator_loses_less_with_a_smaller_tolerance(friction, tolerance, most, tmp_path):
    """While the ball leaves, the dashpot cancels its elastic force: what the springs still hold then, 1 % of the kinetic energy,
    is dissipated by dashpot and friction. Nothing accelerates the ball, so that one step passes it whatever the tolerance, and
    the whole 1 % was booked as the integrator's own loss (0.0101 and 0.0102)."""
    path = tmp_path / "scene.toml"
    text = SCENE.replace("friction = 0.3", f"friction = {friction}").replace("restitution = 0.1", "restitution = 0.5")
    path.write_text(text.replace('"0.1 m/s"', '"0.5 m/s"'))
    changes = {"solver.integrator": "implicit", "solver.tolerance": tolerance, "output.every": "40 ns"}
    with thirdbody.run(thirdbody.Scene.load(path).with_settings(changes), out=tmp_path / "run", threads=1, progress=False) as run:
        energy = {name: run.series[f"energy_{name}"] for name in ("kinetic", "numerical", "residual")}
    assert abs(energy["residual"][-1]) < 1e-6 * energy["kinetic"][0]
    # measured 0.0016 to 0.0022 and 0.0007: of first order in the step in which the force ends
    assert abs(energy["numerical"][-1]) < most * energy["kinetic"][0]


def test_the_peak_pressure_of_an_impact_is_that_of_the_indentation(bounced):
    """At first touch nearly all of the force is the dashpot's, on a contact area of nearly nothing: no pressure of Hertz'."""
    e_star, radius, run = 210e9 / (1.0 - 0.3**2) / 2.0, 5e-6, bounced
    of_force, peaks = [], []
    for frame in range(run.frames):
        contacts, pressure = run.contacts(frame), run.array("clumps", "peak_pressure", frame)
        peaks.append(pressure[0])
        expected = 2.0 * e_star / np.pi * np.sqrt(contacts["overlap"].max(initial=0.0) / radius)
        np.testing.assert_allclose(pressure, expected, rtol=1e-12)  # round-off of the same closed form
        if len(contacts["overlap"]):
            of_force.append(1.5 * contacts["normal_force"][0] / (np.pi * contacts["contact_radius"][0] ** 2) / expected)
    assert max(of_force) > 1.5, "the scene must show a force that is the dashpot's"
    assert run.summary()["peak_pressure"] == max(peaks)
