"""Wear that acts back on the plates: volume, grooves by Archard's law, energy that goes with the worn depth, and what follows.

Flakes of three spheres in a row along x, side by side, stick to the upper plate by its larger friction and grind the lower one.
Their tracks lie nearer to each other than what the worn depth resolves, so that they make one groove.
"""

import functools
import re

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from steel import STEEL
from trajectories import contents
import thirdbody
from thirdbody.errors import GuardStop, Interrupted
from thirdbody.render.surfaces import read_plate_surfaces
from thirdbody.report.surface import surface_report
from thirdbody.runner.run_loop import WallTimes
from thirdbody.runner.simulate import execute, prepare
from thirdbody.surfaces.surface import Surface
from thirdbody.surfaces.wear import worn_surface

MICRO = 1e-6
LENGTH, APART, LOAD, K = 40.0, 1.0, 1e-4, 1e-15  # of the domain [um], of tracks [um], load of a flake [N], wear [m3/J]
FLAKES = range(12, 29)  # y [um]
LESS = STEEL.replace("friction = 0.30", "friction = 0.20")


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("cells", "points"), [((40, 30), (64, 48)), ((64, 48), (40, 30)), ((33, 17), (80, 50)), ((50, 50), (50, 50))]
)
def test_the_volume_taken_is_that_of_the_map(cells, points, seed):
    """The mean of a spline through periodic heights is theirs, so both volumes are sums; they agree but for rounding."""
    rng, size = np.random.default_rng(seed), (50e-6, 30e-6)
    depth = 1e-9 * rng.random(cells[::-1]) ** 8  # spots
    before = Surface(1e-7 * rng.standard_normal(points[::-1]), size, 8e-6)
    taken = before.coefficients - worn_surface(before, depth).coefficients
    area = size[0] * size[1]
    assert taken.mean() * area == pytest.approx(depth.mean() * area, rel=1e-9)
    # the Gaussian is positive: what it leaves of waves that the points cannot hold is below 6 %
    assert taken.min() > -0.06 * taken.max()


def test_a_worn_wave_keeps_its_place_and_what_the_filter_leaves():
    """ISO 16610-21: a wave of the cut-off is halved, one of three times that keeps 2^(-1/9); both stay where the cells are."""
    n, short = 240, 4e-6
    size = (48e-6, 24e-6)
    flat = Surface(np.zeros((96, 192)), size, short)
    middles = (np.arange(n) + 0.5) * (size[0] / n)
    for wave in (short, 3.0 * short):
        depth = np.broadcast_to(1e-9 * (1.0 + np.cos(2.0 * np.pi * middles / wave)), (n // 2, n))
        x = np.arange(192) * (size[0] / 192)
        left = 2.0 ** -((short / wave) ** 2)
        expected = -1e-9 * (1.0 + left * np.cos(2.0 * np.pi * x / wave))
        assert worn_surface(flat, depth).heights[7] == pytest.approx(expected, abs=1e-9 * 1e-12)


def scene(flakes=FLAKES, every="40 um", **settings):
    places = ", ".join(f'["{(7 * y) % 40} um", "{y} um", "2 um"]' for y in flakes)
    text = f"""{LESS}
[materials.grip]
youngs_modulus = "210 GPa"
poisson_ratio = 0.3
density = "7850 kg/m3"
[[pairs]]
between = ["grip", "steel"]
friction = 0.8
restitution = 0.6
[[debris]]
material = "steel"
kind = "spheres"
shape = [
  {{center = ["-3 um", "0 um", "0 um"], radius = "2 um"}}, {{center = ["0 um", "0 um", "0 um"], radius = "2 um"}},
  {{center = ["3 um", "0 um", "0 um"], radius = "2 um"}},
]
positions = [{places}]
[domain]
size = ["{LENGTH:g} um", "40 um"]
[plates.wear]
distance = "{every}"
times = 1000
[plates.lower]
material = "steel"
[plates.upper]
material = "grip"
support = "load_per_particle"
load = "0.1 mN"
motion = {{x = {{velocity = "1 mm/s"}}}}
[contact]
debris_contact = "none"
[measures]
cell = "1 um"
wear = {{plates = "{K} m3/J"}}
[solver]
integrator = "implicit"
distance = "{every}"
[output]
every = "{every}"
"""
    return thirdbody.Scene.parse(text).with_settings(settings)


ONE_PASS = {"solver.distance": "160 um", "output.every": "40 um", "solver.largest_step": "0.1 um"}
"""Four passes of the row over the whole length of the domain, with depth taken after each. What a step wears lies in the cell in
which it ends, so steps are a tenth of a cell."""
FAST = {
    "solver.integrator": "explicit", "plates.upper.motion.x.velocity": "1 m/s", "solver.distance": "2 um",
    "output.every": "0.5 um", "plates.wear.distance": "0.5 um", "plates.wear.times": 10000,
}  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory):

    @functools.cache
    def run(integrator):
        folder = tmp_path_factory.mktemp("worn") / "run"
        chosen = scene(**ONE_PASS) if integrator == "implicit" else scene((19, 20, 21), **FAST)
        return thirdbody.run(chosen, out=folder, threads=1, progress=False)

    return run


integrators = pytest.mark.parametrize("integrator", ["implicit", "explicit"])


@integrators
def test_what_is_taken_is_what_was_worn(runs, integrator):
    """Times the factor, but for what settling wore, and for slip of the last update itself, as its contacts lose load: 1e-7, and
    3e-6 in a way eighty times shorter. From the surfaces as from the maps."""
    run = runs(integrator)
    times, area = float(run.scene.plates.wear.times), (LENGTH * MICRO) * 40e-6
    for side in ("lower", "upper"):
        maps, surface = run.maps(side), run.surface(side)
        taken, worn = (maps[name].mean() * area for name in ("surface_wear", "wear_depth"))
        assert run.series[f"worn_volume_{side}"][-1] == pytest.approx(taken, rel=1e-12, abs=1e-40)
        assert taken == pytest.approx(times * (worn - run.maps(side, 1)["wear_depth"].mean() * area), rel=1e-5, abs=1e-30)
        assert (run.surface(side, 0).coefficients - surface.coefficients).mean() * area == pytest.approx(
            taken, rel=1e-6, abs=1e-30
        )
        assert run.series[f"rms_height_{side}"][-1] == pytest.approx(surface.heights.std(), rel=1e-9)


def test_a_groove_is_as_deep_as_archard_says(runs):
    """k p s with p = load of the row over width times length of the groove, in its middle half; the row sinks with it, and its
    patches carry their loads. To 2 %: edges are smeared over 4 um, and loads move a little to where less was worn."""
    run = runs("implicit")
    depth = K * 1000.0 * LOAD / (APART * MICRO * LENGTH * MICRO) * run.series["distance"]
    rows = np.arange(36, 45)  # of points half a micrometre apart
    for frame, expected in enumerate(depth):
        if expected > 0.0:
            assert -run.surface("lower", frame).heights[rows].mean() == pytest.approx(expected, rel=0.02)
    middle = [list(FLAKES).index(y) for y in range(18, 23)]
    z = [run.bodies(frame)["position"][middle, 2] for frame in range(run.frames)]
    # a frame shows a row that has not yet sunk by what was taken just then
    assert np.mean(z[-2] - z[-1]) == pytest.approx(depth[-2] - depth[-3], rel=0.02)
    assert run.series["upper_force"][-1, 2] == pytest.approx(LOAD * len(FLAKES), rel=1e-6)


@integrators
def test_the_energy_of_the_worn_depth(runs, integrator):
    """Where an overlap shrinks from d + c to d, Hertz' contacts lose 2/5 N d ((1 + c/d)^(5/2) - 1): by the contacts of frames in
    which nothing has moved yet, and by the surfaces. Left out is that the effective radius changes too: 0.4 % of that at the ends
    of short tracks, where the surface bends most."""
    run, lost = runs(integrator), 0.0
    line = run.series["energy_wear"]
    for frame in range(2, run.frames):
        contacts = run.contacts(frame)
        on = (contacts["partner"] == -1) & (contacts["normal_force"] > 0.0)
        n, d, (x, y, _) = contacts["normal_force"][on], contacts["overlap"][on], contacts["position"][on].T
        before, after = (heights_at(run.surface("lower", k), x, y) for k in (frame - 1, frame))
        lost = np.sum(0.4 * n * d * ((1.0 + (before - after) / d) ** 2.5 - 1.0))
        assert line[frame] - line[frame - 1] == pytest.approx(lost, rel=5e-3)
    assert abs(run.series["energy_residual"][-1]) < RESIDUAL[integrator] * run.series["energy_plate_work"][-1]
    assert line[-1] > 100.0 * abs(run.series["energy_residual"][-1])


RESIDUAL = {"implicit": 1e-8, "explicit": 1e-4}
"""Over the work of the plates; as without wear."""


def test_pictures_reports_and_exports_show_the_worn_surface(runs, tmp_path, capsys):
    run = runs("explicit")
    worn, before = (run.surface("lower", frame).heights for frame in (-1, 0))
    assert before.max() == before.min() == 0.0 > worn.min()
    assert read_plate_surfaces(run, run.frames - 1)["lower"].low == worn.min()
    assert run.to_pyvista()["lower_surface"].point_data["height"].min() == worn.min()
    surface_report(run.path, [tmp_path / "map.npz"], "lower", (None, None), {}, (), False)
    assert "rms height" in capsys.readouterr().out
    assert np.array_equal(np.load(tmp_path / "map.npz")["heights"], worn)


def test_too_much_at_once_stops_the_run_and_names_what_would_do(tmp_path):
    """More than a tenth of the overlap; what was computed before is kept. The factor that it names does, one a tenth larger does
    not."""
    chosen = scene((19, 20, 21), **FAST)
    with pytest.raises(GuardStop, match=r"at t = \S+ s: wear would take \S+ m from the lower plate at \(.*overlap") as stop:
        thirdbody.run(chosen.with_settings({"plates.wear.times": 1e7}), out=tmp_path / "run", progress=False)
    fitting = float(re.search(r"times = (\S+) would do", str(stop.value))[1])
    with thirdbody.open(tmp_path / "run") as run:
        assert run.frames == 2 and not run.summary()["finished"] and not run.maps("lower")["surface_wear"].any()
    once = chosen.with_settings({"solver.distance": "0.5 um", "plates.wear.times": fitting})
    run = thirdbody.run(once, out=tmp_path / "run", overwrite=True, progress=False)
    contacts = run.contacts(-1)
    on = (contacts["partner"] == -1) & (contacts["normal_force"] > 0.0)
    assert 0.0 < -run.surface("lower").heights.min()
    assert -run.surface("lower").heights.min() < 0.1 / 0.9 * np.max(contacts["overlap"][on])
    with pytest.raises(GuardStop, match="the overlap"):
        thirdbody.run(once.with_settings({"plates.wear.times": 1.1 * fitting}), out=tmp_path / "other", progress=False)


DRIVERS = {
    "explicit": FAST | {"solver.distance": "1 um", "plates.wear.distance": "0.2 um"},
    "implicit": {"solver.distance": "4 um", "output.every": "1 um", "plates.wear.distance": "0.7 um"},
    "by time": {
        "solver.distance": None, "solver.duration": "4 ms", "output.every": "1.5 ms", "plates.wear.distance": None,
        "plates.wear.cycles": 2, "plates.upper.motion.x": {"stroke": "0.2 um", "frequency": "1 kHz"}, "plates.wear.times": 100,
    },
    "together": {
        "solver.distance": "2 um", "output.every": "1 um", "plates.wear.distance": "0.7 um", "plates.upper.support": "rigid",
        "plates.upper.load": "0.3 mN",
    },
    "meeting": {
        "solver.distance": "2 um", "output.every": "1 um", "plates.wear.distance": "0.7 um", "contact.debris_contact": "auto",
    },
}  # fmt: skip


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_resumed_run_has_the_same_bits(tmp_path, driver):
    """Stopped at several instants, before and after updates; its ledger closes, with forces that jump at the updates."""
    flakes = (12, 20, 28) if driver == "meeting" else (19, 20, 21)
    chosen = scene(flakes, **DRIVERS[driver])
    execute(prepare(chosen), tmp_path / "whole", times=WallTimes(0.0))
    wanted = contents(tmp_path / "whole")
    for first in (2, 9, 25):
        calls, folder = iter(range(10**9)), tmp_path / f"cut{first}"
        try:
            execute(prepare(chosen), folder, stop=lambda calls=calls, first=first: next(calls) >= first)
        except Interrupted:
            thirdbody.resume(folder, progress=False).close()
        found = contents(folder)
        assert [name for name in wanted if found[name] != wanted[name]] == [] and found.keys() == wanted.keys()
    with thirdbody.open(tmp_path / "whole") as run:
        assert run.series["energy_wear"][-1] > 0.0 and run.series["worn_volume_lower"][-1] > 0.0
        assert abs(run.series["energy_residual"][-1]) < 1e-4 * run.series["energy_plate_work"][-1]


def heights_at(surface, x, y):
    at = y / surface.spacing[1], x / surface.spacing[0]
    return map_coordinates(surface.coefficients, at, order=3, mode="grid-wrap", prefilter=False)
