"""Robustness cases of a ball between a rough lower plate and a flat upper one, which drags it.

Where a sphere of radius R rests on heights h is a maximum, that of h(u) + sqrt(R^2 - u^2) over the distance u from below its
centre; forces follow from the slope there by statics.
"""

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.assembly.simulation import build
from thirdbody.errors import InputError
from thirdbody.kernels.columns import record
from thirdbody.kernels.columns.sides import LOWER, UPPER
from thirdbody.scene.model import LowerPlate, Plates, UpperPlate
from thirdbody.scene.surfaces import Groove, Sine, SurfaceFile, Waves
from thirdbody.studies.robustness.case import CaseRun, Trial
from thirdbody.studies.robustness.scenes import LOAD, MICRON, STEEL, clump, drag, scene

SIZE, R, SPEED = 40.0, 5.0, 0.5
"""Side of the domain and radius of the ball [um], speed of the upper plate [m/s]."""

MIDDLE = 0.5 * SIZE
"""Place of the ball along x and y [um]."""

TILT = 1e-2
"""Deviation of forces over the load: overlaps move the contacts along the surface, and bounces have not died out to the last."""

SUNK = 2e-9
"""Deviation of the height of a ball from that of a rigid one [m], beyond what it sank at first: overlaps of 5 nm vary with the
effective radius.
"""

SUNK_ON_EDGES = 1e-8
"""The same on edges with a radius of 0.1 um and where the dashpot of the patch, which falls with the ball, carries some load."""

Profile = Callable[[np.ndarray], np.ndarray]


def wavy_plate(trial: Trial) -> None:
    """A ball rolls from a crest into a valley: it keeps to the surface, and its forces go along the chord of its contacts.

    The crest is a border between cells of the spline, which traps a sphere where the gradient force jumps.
    """
    wave = Sine(amplitude=0.15 * MICRON, wavelength=8.0 * MICRON, phase=math.pi)  # a valley at the origin, a crest in the middle
    run = trial.start(_dragged(trial, Waves(wave=(wave,)), 0.3, 0.2))
    heights, chords = list[float](), list[float]()

    def at_stop() -> None:
        heights.append(_over_rigid(run))
        chords.append(_beside_chord(run))

    run.follow([4e-7 * k for k in range(1, 21)], at_stop=at_stop)
    fall = run.state.bodies.position[0, 2] - R * MICRON
    trial.check_true(f"in the valley ({fall / MICRON:.3f} um)", fall < -0.13 * MICRON)
    trial.check("height over the rigid path, m", np.ptp(heights), SUNK)
    trial.check("force beside the chord", max(chords), TILT)


def narrow_groove(trial: Trial) -> None:
    """A ball over a groove narrower than itself lies on both edges: told, and N = W/(2 cos th); drag does not lift it out."""
    groove = Groove(depth=2e-6, width=6e-6, flank=math.radians(60.0), rounding=0.5e-6, wavelength=SIZE * MICRON, phase=math.pi)
    for friction in (0.0, 0.2):
        run = trial.start(_dragged(trial, Waves(wave=(groove,)), friction, 0.5))
        start = run.simulation.settle
        run.to(time=start)
        _check_report(trial, run)
        profile = _profile(run)
        th = _resting_angle(lambda u, profile=profile: profile(MIDDLE * MICRON + u))  # type: ignore[misc]
        run.follow([5e-8 * k for k in range(1, 11)])
        normal, leaning = _normal_forces(run), _normals(run)[:, 0]
        trial.check_true(f"mu = {friction}: two contacts below (there are {len(normal)})", len(normal) == 2)
        trial.check(f"mu = {friction}: normals - sin th", np.abs(np.abs(leaning) - math.sin(th)).max(), TILT)
        trial.check(f"mu = {friction}: friction coefficient - mu", abs(run.friction() - friction), TILT)
        moved = run.state.bodies.position[0, 0] / MICRON - MIDDLE
        trial.check(f"mu = {friction}: displacement, um", abs(moved), 0.02)
        if not friction:
            trial.check("normal forces - W/(2 cos th)", np.abs(normal - 0.5 / math.cos(th)).max(), TILT)


def step_of_a_file(trial: Trial) -> None:
    """A measured surface with a step: smoothed, told, and a ball rolls down the flank; a step of a wrong unit is refused.

    The edge hands the ball over to the bottom, where the filter has left ripples: one has a trough just sharper than the ball.
    """
    x = np.arange(0.0, 50.0, 0.25)
    heights = np.where(np.abs(x - 25.0) < 9.0, 1.5, 0.0) * np.ones((len(x), 1))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "step.npz"
        np.savez(path, heights=heights, spacing=0.25, unit="um")
        surface = SurfaceFile(file=str(path), level="mean", short=2.0 * MICRON)
        run = trial.start(_dragged(trial, surface, 0.7, 1.03, x=32.5, speed=0.1))
        np.savez(path, heights=heights, spacing=0.25, unit="um", height_unit="mm")
        trial.check_true(
            "a step of millimetres is refused", "is the unit right?" in _refusal(_dragged(trial, surface, 0.7, 1.03))
        )
    warned = [warning for warning in run.simulation.warnings if "does the file hold steps?" in warning]
    trial.check_true("warned of a step, and of what became of it", len(warned) == 1 and "flanks as wide" in warned[0])
    over = list[float]()
    run.follow([2e-7 * k for k in range(1, 61)], at_stop=lambda: over.append(_over_rigid(run)))
    start, end = (_rigid_height(_profile(run), x * MICRON) for x in (32.5, 36.5))
    trial.check_true("it rolled down", end < start - MICRON and run.state.bodies.position[0, 2] < end + 0.1 * MICRON)
    trial.check("height over the rigid path, m", np.ptp(over), SUNK_ON_EDGES)


def sharp_valleys(trial: Trial) -> None:
    """A ball in a pit sharper than itself: told, four contacts with N = W/(4 cos th); it rolls out over two of them, and on."""
    amplitude, wavelength = 0.3 * MICRON, 5.0 * MICRON
    waves = [Sine(amplitude=amplitude, wavelength=wavelength, direction=axis, phase=math.pi) for axis in ("x", "y")]
    q = 2.0 * math.pi / wavelength
    th = _resting_angle(lambda u: -2.0 * amplitude * np.cos(q * u / math.sqrt(2.0)))
    for friction in (0.0, 0.6):
        run = trial.start(_dragged(trial, Waves(wave=tuple(waves)), friction, 0.0))
        run.to(time=run.simulation.settle)
        _check_report(trial, run)
        normal = _normal_forces(run)
        trial.check_true(f"mu = {friction}: four contacts below (there are {len(normal)})", len(normal) == 4)
        trial.check(f"mu = {friction}: their slope - tan th", np.abs(_normals(run)[:, 2] - math.cos(th)).max(), TILT)
        if not friction:
            trial.check("normal forces - W/(4 cos th)", np.abs(normal - 0.25 / math.cos(th)).max(), TILT)
            run.end()
            continue
        numbers, memory = list[int](), list[float]()

        def at_stop(run: CaseRun = run, numbers: list[int] = numbers, memory: list[float] = memory) -> None:
            numbers.append(len(_normal_forces(run)))
            memory.append(run.largest_history())

        run.follow([2e-7 * k for k in range(1, 51)], at_stop=at_stop)
        trial.check_true(f"contacts came and went {numbers}", min(numbers) < 4 and set(numbers) <= {1, 2, 3, 4})
        moved = run.state.bodies.position[0, 0] / MICRON - MIDDLE
        trial.check(f"displacement over half of that of the plate - 1 ({moved:.3f} um)", abs(moved / 5.0 - 1.0), 0.2)
        trial.check("memory of open contacts", max(memory), 0.0)


def _dragged(trial: Trial, surface: Any, friction: float, gap: float, x: float = MIDDLE, speed: float = SPEED) -> Any:
    """Return the scene of a ball at x [um], `gap` [um] above the mean plane of a surface."""
    upper = UpperPlate(material="ball", support="load_per_particle", load=LOAD, motion=drag(speed))
    plates = Plates(lower=LowerPlate(material="ball", surface=surface), upper=upper)
    body = clump([(0.0, 0.0, 0.0, R)], x * MICRON, MIDDLE * MICRON, gap=gap * MICRON)
    side = SIZE * MICRON
    return scene(trial, [body], {"ball": STEEL}, friction, 0.5, side, "ball", upper, plates=plates)


def _refusal(given: Any) -> str:
    try:
        build(given)
    except InputError as error:
        return str(error)
    return "accepted"


def _check_report(trial: Trial, run: CaseRun) -> None:
    """Check that `thirdbody check` tells of several contacts."""
    trial.check_true(
        "told that spheres touch at several points", run.simulation.surface_scales["lower"].document()["several_contacts"]
    )


def _profile(run: CaseRun) -> Profile:
    """Return the heights of the lower plate along x [m], where they do not depend on y."""
    from scipy.interpolate import CubicSpline

    heights = run.simulation.surfaces["lower"].heights
    row = heights[len(heights) // 2]  # below the ball
    x = np.linspace(0.0, SIZE * MICRON, len(row) + 1)
    return CubicSpline(x, np.append(row, row[0]), bc_type="periodic")  # type: ignore[no-any-return]


def _rigid_height(profile: Profile, x: float) -> float:
    """Return the height of the centre of a rigid ball at x [m]."""
    u = np.linspace(-R, R, 20001) * MICRON
    return float((profile(x + u) + np.sqrt(np.maximum((R * MICRON) ** 2 - u**2, 0.0))).max())


def _over_rigid(run: CaseRun) -> float:
    x, _, z = run.state.bodies.position[0]
    return float(z) - _rigid_height(_profile(run), float(x))


def _resting_angle(profile: Profile) -> float:
    """Return the angle between the vertical and the normal where a rigid ball rests in a valley of this profile."""
    u = np.linspace(0.0, 0.999 * R, 20001) * MICRON
    return math.asin(u[np.argmax(profile(u) + np.sqrt((R * MICRON) ** 2 - u**2))] / (R * MICRON))


def _rows(run: CaseRun, side: int) -> np.ndarray:
    """Return the records of closed contacts with a plate."""
    return run.state.slots.R[run.loaded() & (run.state.slots.sides == side)]


def _normal_forces(run: CaseRun) -> np.ndarray:
    """Return the normal forces of the lower plate, over the load."""
    return _rows(run, LOWER)[:, record.NORMAL_FORCE] / LOAD


def _normals(run: CaseRun) -> np.ndarray:
    return _rows(run, LOWER)[:, record.NORMAL3]


def _beside_chord(run: CaseRun) -> float:
    """Return by how much the force of the upper plate leans away from the line through both contacts."""
    (top,), (low,) = (_rows(run, side)[:, record.POINT3] for side in (UPPER, LOWER))
    return abs(run.friction() + (low[0] - top[0]) / (low[2] - top[2]))
