"""Hard cases of a ball between a rough lower plate and a flat upper one, which drags it. Where a sphere rests on heights h is a
maximum of h(u) + sqrt(R^2 - u^2) over the distance u from below its centre; forces follow from the slope there by statics."""

import math
import tempfile
from pathlib import Path

import numpy as np
from hard.trial import LOAD, MICRON, Trial, clump, drag, every, scene
from scipy.interpolate import CubicSpline
from theory.builders import STEEL
from thirdbody.kernels.tables import LOWER, UPPER, record
from thirdbody.scene.model import LowerPlate, Plates, UpperPlate
from thirdbody.scene.surfaces import Groove, Sine, SurfaceFile, Waves

SIZE, R = 40.0, 5.0  # side of the domain and radius of the ball [um]
MIDDLE = 0.5 * SIZE  # place of the ball along x and y [um]
TILT = 1e-2
"""Deviation of forces over the load: overlaps move the contacts along the surface, and bounces have not died out to the last."""
SUNK = 2e-9
"""Deviation of the height of a ball from that of a rigid one [m], beyond what it sank at first: overlaps of 5 nm vary with the
effective radius."""
SUNK_ON_EDGES = 1e-8
"""The same on edges with a radius of 0.1 um and where the dashpot of the patch, which falls with the ball, carries some load."""


def dragged(trial, surface, friction, gap, x=MIDDLE, speed=0.5):
    upper = UpperPlate(material="ball", support="load_per_particle", load=LOAD, motion=drag(speed))
    plates = Plates(lower=LowerPlate(material="ball", surface=surface), upper=upper)
    debris = [clump([(0.0, 0.0, 0.0, R)], x * MICRON, MIDDLE * MICRON, gap=gap * MICRON)]
    keys = {"restitution": 0.5, "size": SIZE * MICRON, "lower": "ball", "upper": upper, "plates": plates}
    return scene(trial, debris, {"ball": STEEL}, friction, **keys)


def several_contacts(run):
    run.to(time=run.simulation.settle)
    return run.simulation.surface_scales["lower"].document()["several_contacts"]


def profile_of(run):
    heights = run.simulation.surfaces["lower"].heights
    row = heights[len(heights) // 2]
    return CubicSpline(np.linspace(0.0, SIZE * MICRON, len(row) + 1), np.append(row, row[0]), bc_type="periodic")


def rigid_height(profile, x):
    u = np.linspace(-R, R, 20001) * MICRON
    return float((profile(x + u) + np.sqrt(np.maximum((R * MICRON) ** 2 - u**2, 0.0))).max())


def over_rigid(run):
    x, _, z = run.position()
    return float(z) - rigid_height(profile_of(run), float(x))


def resting_angle(profile):
    """The angle between the vertical and the normal where a rigid ball rests in a valley of this profile."""
    u = np.linspace(0.0, 0.999 * R, 20001) * MICRON
    return math.asin(u[np.argmax(profile(u) + np.sqrt((R * MICRON) ** 2 - u**2))] / (R * MICRON))


def closed(run, side=LOWER):
    return run.state.slots.R[run.loaded() & (run.state.slots.sides == side)]


def normal_forces(run):
    return closed(run)[:, record.NORMAL_FORCE] / LOAD


def wavy_plate(trial: Trial) -> None:
    """A ball rolls from a crest into a valley: it keeps to the surface, and its forces go along the chord of its contacts. The
    crest is a border between cells of the spline, which traps a sphere where the gradient force jumps."""
    wave = Sine(amplitude=0.15 * MICRON, wavelength=8.0 * MICRON, phase=math.pi)  # a valley at the origin, a crest in the middle
    run = trial.start(dragged(trial, Waves(wave=(wave,)), 0.3, 0.2))

    def beside_chord():
        (top,), (low,) = (closed(run, side)[:, record.POINT3] for side in (UPPER, LOWER))
        return abs(run.friction() + (low[0] - top[0]) / (low[2] - top[2]))

    heights, chords = run.follow(every(4e-7, 20), lambda: over_rigid(run), beside_chord)
    fall = run.position()[2] - R * MICRON
    trial.check_true(f"in the valley ({fall / MICRON:.3f} um)", fall < -0.13 * MICRON)
    trial.check("height over the rigid path, m", np.ptp(heights), SUNK)
    trial.check("force beside the chord", chords, TILT)


def narrow_groove(trial: Trial) -> None:
    """A ball over a groove narrower than itself lies on both edges: told, and N = W/(2 cos th); drag does not lift it out."""
    groove = Groove(depth=2e-6, width=6e-6, flank=math.radians(60.0), rounding=0.5e-6, wavelength=SIZE * MICRON, phase=math.pi)
    for mu in (0.0, 0.2):
        run = trial.start(dragged(trial, Waves(wave=(groove,)), mu, 0.5))
        trial.check_true("told that spheres touch at several points", several_contacts(run))
        profile = profile_of(run)
        th = resting_angle(lambda u, profile=profile: profile(MIDDLE * MICRON + u))
        run.follow(every(5e-8, 10))
        normal, leaning = normal_forces(run), closed(run)[:, record.NORMAL3][:, 0]
        trial.check_true(f"mu = {mu}: two contacts below (there are {len(normal)})", len(normal) == 2)
        trial.check(f"mu = {mu}: normals - sin th", np.abs(np.abs(leaning) - math.sin(th)), TILT)
        trial.check(f"mu = {mu}: friction coefficient - mu", abs(run.friction() - mu), TILT)
        trial.check(f"mu = {mu}: displacement, um", abs(run.position()[0] / MICRON - MIDDLE), 0.02)
        if not mu:
            trial.check("normal forces - W/(2 cos th)", np.abs(normal - 0.5 / math.cos(th)), TILT)


def step_of_a_file(trial: Trial) -> None:
    """A measured surface with a step: smoothed, told, and a ball rolls down the flank; a step of a wrong unit is refused. The
    edge hands the ball over to the bottom, where the filter has left ripples: one has a trough just sharper than the ball."""
    x = np.arange(0.0, 50.0, 0.25)
    heights = np.where(np.abs(x - 25.0) < 9.0, 1.5, 0.0) * np.ones((len(x), 1))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "step.npz"
        np.savez(path, heights=heights, spacing=0.25, unit="um")
        surface = SurfaceFile(file=str(path), level="mean", short=2.0 * MICRON)
        run = trial.start(dragged(trial, surface, 0.7, 1.03, x=32.5, speed=0.1))
        np.savez(path, heights=heights, spacing=0.25, unit="um", height_unit="mm")
        trial.check_refused("a step of millimetres", lambda: dragged(trial, surface, 0.7, 1.03), "is the unit right?")
    warned = [warning for warning in run.simulation.warnings if "does the file hold steps?" in warning]
    trial.check_true("warned of a step, and of what became of it", len(warned) == 1 and "flanks as wide" in warned[0])
    (over,) = run.follow(every(2e-7, 60), lambda: over_rigid(run))
    start, end = (rigid_height(profile_of(run), x * MICRON) for x in (32.5, 36.5))
    trial.check_true("it rolled down", end < start - MICRON and run.position()[2] < end + 0.1 * MICRON)
    trial.check("height over the rigid path, m", np.ptp(over), SUNK_ON_EDGES)


def sharp_valleys(trial: Trial) -> None:
    """A ball in a pit sharper than itself: told, four contacts with N = W/(4 cos th); it rolls out over two of them, and on."""
    amplitude, wavelength = 0.3 * MICRON, 5.0 * MICRON
    waves = tuple(Sine(amplitude=amplitude, wavelength=wavelength, direction=axis, phase=math.pi) for axis in ("x", "y"))
    q = 2.0 * math.pi / wavelength
    th = resting_angle(lambda u: -2.0 * amplitude * np.cos(q * u / math.sqrt(2.0)))
    for mu in (0.0, 0.6):
        run = trial.start(dragged(trial, Waves(wave=waves), mu, 0.0))
        trial.check_true("told that spheres touch at several points", several_contacts(run))
        normal = normal_forces(run)
        trial.check_true(f"mu = {mu}: four contacts below (there are {len(normal)})", len(normal) == 4)
        trial.check(f"mu = {mu}: their slope - tan th", np.abs(closed(run)[:, record.NORMAL3][:, 2] - math.cos(th)), TILT)
        if not mu:
            trial.check("normal forces - W/(4 cos th)", np.abs(normal - 0.25 / math.cos(th)), TILT)
            run.end()
            continue
        numbers, memory = run.follow(every(2e-7, 50), lambda run=run: len(normal_forces(run)), run.memory)
        trial.check_true(f"contacts came and went {numbers}", min(numbers) < 4 and set(numbers) <= {1, 2, 3, 4})
        moved = run.position()[0] / MICRON - MIDDLE
        trial.check(f"displacement over half of that of the plate - 1 ({moved:.3f} um)", abs(moved / 5.0 - 1.0), 0.2)
        trial.check_memory(memory)
