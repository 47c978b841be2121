"""Surfaces as data: random ones with their spectrum, waves and grooves, scans made periodic, the spline, the statistics."""

import math
import re

import numpy as np
import pytest
from each import each
from scipy.ndimage import map_coordinates
from scipy.signal import find_peaks, resample
from thirdbody.assembly.simulation import build
from thirdbody.assembly.surfaces import plate_surfaces
from thirdbody.errors import InputError
from thirdbody.report.surface import law_text
from thirdbody.runner.checkpoint import prints_of
from thirdbody.scene.model import Scene
from thirdbody.surfaces import grid
from thirdbody.surfaces.grid import groove_heights, phases, self_affine, sine_heights
from thirdbody.surfaces.scan import HeightMap, ScanOptions, cropped, fill_missing, levelled, periodic_scan
from thirdbody.surfaces.statistics import radial_spectrum, surface_statistics, with_spectrum

SIZE = (100e-6, 80e-6)
ROUGH = (0.2e-6, 0.8, 20e-6, 4e-6)
STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7850.0}


def scene(lower, upper=None, **domain):
    plates = {"lower": {"material": "steel", "surface": lower}}
    if upper:
        plates["upper"] = {"material": "steel", "load": 1e-3, "surface": upper}
    return Scene.of({
        "materials": {"steel": STEEL}, "pairs": [{"between": ["steel", "steel"], "friction": 0.3, "restitution": 0.6}],
        "debris": [{"kind": "spheres", "material": "steel", "radius": 5e-6, "count": 1}],
        "domain": {"size": SIZE} | domain, "plates": plates, "solver": {"duration": 1e-6}, "output": {"every": "1 us"},
    })  # fmt: skip


def random_heights(per_wave=grid.POINTS_PER_WAVE, short=4e-6, seed=1, stream=0):
    return self_affine(grid.grid_counts(SIZE, (4e-6 / per_wave,) * 2), SIZE, *ROUGH[:3], short, seed, stream)


def spacing_of(heights):
    return SIZE[0] / heights.shape[1], SIZE[1] / heights.shape[0]


def faults_of(*surfaces, **domain):
    with pytest.raises(InputError) as error:
        scene(*surfaces, **domain)
    return error.value


def test_a_random_surface_has_its_rms_height_and_spectrum():
    heights = random_heights()
    spacing = spacing_of(heights)
    assert np.sqrt(np.mean(heights**2)) == pytest.approx(0.2e-6, rel=1e-12)
    assert abs(heights.mean()) < 1e-12 * 0.2e-6
    law = with_spectrum(surface_statistics(heights, spacing), heights, spacing).law
    # rings of a factor 2^(1/4): the knee and the end are known to one of them
    assert law.hurst == pytest.approx(0.8, abs=0.05) and law.rolls_off
    assert law.long == pytest.approx(20e-6, rel=0.19) and law.short == pytest.approx(4e-6, rel=0.42)
    # Parseval
    spectrum = radial_spectrum(heights, spacing, periodic=True)
    assert np.sum(spectrum.power * spectrum.waves) / (SIZE[0] * SIZE[1]) == pytest.approx(0.04e-12, rel=1e-9, abs=0.0)
    # without a period: the window shows some five of the longest waves; among seeds the sum scatters by 15 %
    spectrum = radial_spectrum(heights, spacing, periodic=False)
    assert np.sum(spectrum.power * spectrum.waves) / (SIZE[0] * SIZE[1]) == pytest.approx(0.04e-12, rel=0.4, abs=0.0)
    for short, narrow in ((4e-6, False), (10e-6, True)):
        heights = random_heights(short=short)
        text = law_text(with_spectrum(surface_statistics(heights, spacing_of(heights)), heights, spacing_of(heights)))
        assert text.startswith("Hurst exponent") and ("uncertain" in text) is narrow, text
    # power outside the band is zero and flat above the long wavelength
    power = np.abs(np.fft.fft2(random_heights())) ** 2
    n_y, n_x = power.shape
    q = np.hypot(np.fft.fftfreq(n_y, 1.0 / n_y)[:, None] / SIZE[1], np.fft.fftfreq(n_x, 1.0 / n_x)[None, :] / SIZE[0])
    inside, flat = (q > 0) & (q <= 1.0 / 4e-6 * (1 + 1e-9)), (q > 0) & (q < 1.0 / 20e-6)
    assert power[~inside].max() < 1e-20 * power.max()  # rounding of the transform
    assert np.ptp(power[flat]) < 1e-9 * power.max()
    steep = power[inside] * np.maximum(q[inside], 1.0 / 20e-6) ** 3.6
    assert np.ptp(steep) < 1e-9 * steep.max()


def test_surfaces_depend_on_seed_and_plate_and_not_on_the_grid():
    coarse, fine = random_heights(8), random_heights(16)
    assert fine[::2, ::2].shape == coarse.shape
    np.testing.assert_allclose(fine[::2, ::2], coarse, atol=1e-12 * 0.2e-6)
    longer, shorter = (np.fft.fft2(random_heights(16, short)) for short in (8e-6, 4e-6))
    low = np.abs(longer) > 1e-9 * np.abs(longer).max()
    np.testing.assert_allclose(np.angle(shorter[low] / longer[low]), 0.0, atol=1e-6)  # the same phases
    # seeds and plates differ
    fields = [random_heights(seed=seed, stream=stream).ravel() for seed, stream in ((1, 0), (1, 1), (2, 0))]
    # some 40 waves longer than the knee carry most of the height: independent fields correlate by 1/sqrt(80), here below 5 of it
    assert np.abs(np.corrcoef(fields)[np.triu_indices(3, 1)]).max() < 0.5
    both = plate_surfaces(scene(*({"rms": 2e-7, "long": 2e-5, "short": 4e-6},) * 2))
    assert np.abs(np.corrcoef(both["lower"].heights.ravel(), both["upper"].heights.ravel()))[0, 1] < 0.5
    # those of PCG64
    phases_of = np.angle(np.fft.fft2(random_heights())[[0, 1, 1], [1, 0, -1]]) / (2.0 * math.pi) % 1.0  # the longest waves
    assert phases_of == pytest.approx([0.6990345474368357, 0.17433552137309583, 0.6451185321972944], rel=1e-9)


def test_the_spline_passes_through_the_heights_and_follows_the_band_limited_surface():
    coarse, fine = random_heights(8), random_heights(32)
    surface = plate_surfaces(scene({"rms": 2e-7, "long": 2e-5, "short": 4e-6, "curvature": False}))["lower"]
    assert (surface.shortest, surface.curvature) == (4e-6, False)
    np.testing.assert_allclose(surface.heights, coarse, atol=1e-18)
    y, x = np.mgrid[0 : fine.shape[0], 0 : fine.shape[1]] / 4.0
    spline = map_coordinates(surface.coefficients, [y, x], order=3, mode="grid-wrap", prefilter=False)
    np.testing.assert_allclose(spline[::4, ::4], coarse, atol=1e-13 * 0.2e-6)
    # the docstring of POINTS_PER_WAVE says 3e-5 to 8e-5 for a decade of wavelengths; shorter ones weigh more here
    assert (spline - fine).std() < 2e-4 * 0.2e-6
    # a sine has the statistics of a sine
    amplitude, wavelength = 0.3e-6, 20e-6
    surface = plate_surfaces(scene({"wave": {"amplitude": amplitude, "wavelength": wavelength, "phase": 1.0}}))["lower"]
    statistics, k = surface_statistics(surface.heights, surface.spacing), 2.0 * math.pi / wavelength
    assert statistics.rms_height == pytest.approx(amplitude / math.sqrt(2.0), rel=1e-12)
    assert statistics.rms_slope == pytest.approx(amplitude * k / math.sqrt(2.0), rel=1e-4)  # of the spline: (k h)^4/180
    # of the spline: (k h)^2/12 = 0.32 % at 32 points, and the crest lies up to half a step from a point
    assert (statistics.crest_curvature, statistics.valley_curvature) == pytest.approx((amplitude * k**2,) * 2, rel=0.01)
    assert statistics.kurtosis == pytest.approx(1.5, rel=1e-12) and abs(statistics.skewness) < 1e-12
    assert with_spectrum(statistics, surface.heights, surface.spacing).law is None
    # sharp crests: the curvature is cos t + 0.4 cos 2 t, at least -0.7125
    t = 2.0 * math.pi * np.arange(64) / 64.0
    sharp = surface_statistics(np.tile(amplitude * (np.cos(t) + 0.1 * np.cos(2.0 * t)), (16, 1)), (wavelength / 64.0,) * 2)
    curvatures = sharp.crest_curvature, sharp.valley_curvature, sharp.rms_curvature
    assert curvatures == pytest.approx(amplitude * k**2 * np.array([1.4, 0.7125, 0.5 * math.sqrt(0.58)]), rel=0.01)
    shape = sharp.skewness, sharp.highest / amplitude, sharp.lowest / amplitude
    assert shape == pytest.approx((0.075 / 0.505**1.5, 1.1, -0.9), rel=1e-9)
    # a wave in any direction has whole numbers in the domain
    nearest = grid.whole_waves(SIZE, 10e-6, math.radians(40.0))
    assert nearest.along == (8, 5)
    assert grid.whole_waves(SIZE, 1.0, math.radians(80.0)).along == (0, 1)  # longer than the domain
    assert 1.0 / nearest.wavelength == pytest.approx(math.hypot(8 / SIZE[0], 5 / SIZE[1]), rel=1e-12)
    power = np.abs(np.fft.fft2(sine_heights(phases((64, 80), nearest.along, 0.0), 1.0)))
    assert np.argwhere(power > 1.0).tolist() == [[5, 8], [59, 72]]


def test_a_groove_has_straight_flanks_and_continuous_curvature():
    n, period = 20000, 20e-6
    profile = (2e-6, 8e-6, 3e-6, 0.5e-6, period)
    z = groove_heights(phases((1, n), (1, 0), 0.0), *profile)[0]
    quarter = groove_heights(phases((1, n), (1, 0), 0.5 * math.pi), *profile)[0]  # a groove at a quarter of the distance
    np.testing.assert_allclose(quarter, np.roll(z, n // 4), atol=1e-15)
    x, step = np.arange(n) * period / n, period / n
    assert z.min() == pytest.approx(-2e-6, rel=1e-12) and z.max() == pytest.approx(0.0, abs=1e-21)
    flank = (x > 1e-6 + 0.51e-6) & (x < 4e-6 - 0.51e-6)
    np.testing.assert_allclose(np.diff(z[flank]) / step, 2.0 / 3.0, rtol=1e-6)
    second = np.diff(z, 2) / step**2
    assert second.max() == pytest.approx(2.0 / 3.0 / 0.5e-6, rel=0.01)  # the peak of the triangle, sampled
    # continuous: between neighbours it changes by slope/corner^2 times the step, and no more
    assert np.abs(np.diff(second)).max() < 1.01 * (2.0 / 3.0) / 0.5e-6**2 * step
    v = groove_heights(phases((1, n), (1, 0), 0.0), 3e-6, 6e-6, 3e-6, 0.6e-6, period)[0]
    assert v.min() == pytest.approx(-3e-6 + 0.6e-6 / 3.0, rel=1e-9)  # a V: the bottom is rounded by corner slope/3


def scan():
    """A part of a larger random surface, tilted, so that it is not periodic."""
    heights = self_affine((320, 400), (200e-6, 160e-6), *ROUGH, 3, 0)[:240, :300]
    return HeightMap(heights + np.linspace(0.0, 5e-6, 300), (0.5e-6, 0.5e-6), "scan.npz")


def test_a_scan_becomes_a_smooth_periodic_surface():
    original = scan()
    surface = periodic_scan(original, (200e-6, 100e-6), ScanOptions(short=4e-6, join="blend"))
    inner = surface_statistics(levelled(original.heights, "plane"), original.spacing, periodic=False)
    statistics = surface_statistics(surface.heights, surface.spacing)
    # a window of 150 um shows some seven of the longest waves: its rms height scatters by a tenth
    assert statistics.rms_height == pytest.approx(inner.rms_height, rel=0.25)
    assert statistics.rms_slope == pytest.approx(inner.rms_slope, rel=0.25)
    # a seam with a step or a kink would show as the steepest slope or the sharpest crest
    assert statistics.max_slope < 1.2 * inner.max_slope and statistics.crest_curvature < 1.2 * inner.crest_curvature
    copies = surface.copies
    parts = surface.heights.reshape(copies[1], surface.heights.shape[0] // copies[1], copies[0], -1)
    assert np.ptp(parts, axis=(0, 2)).max() < 1e-15
    assert any("copies of" in note for note in surface.notes)


@pytest.mark.parametrize("periods", [9.3, 17.5, 41.2])
@pytest.mark.parametrize("angle", [0, 35, 90])
def test_a_ground_surface_keeps_crests_and_wavelength(periods, angle):
    n_x, n_y, wavelength = 300, 280, 150e-6 / periods
    y, x = np.mgrid[0:n_y, 0:n_x] * 0.5e-6
    rough = self_affine((640, 640), (320e-6, 320e-6), 5e-9, 0.8, 20e-6, 3e-6, int(periods), 0)[:n_y, :n_x]
    direction = math.radians(angle)
    ground = 0.2e-6 * np.cos(2.0 * np.pi * (x * math.cos(direction) + y * math.sin(direction)) / wavelength) + rough
    surface = periodic_scan(HeightMap(ground + 0.02 * x, (0.5e-6,) * 2, ""), (120e-6, 110e-6), ScanOptions(short=2e-6))
    z = surface.heights - 0.5 * (surface.heights.max() + surface.heights.min())  # parts of a period have a mean of their own
    before = levelled(ground + 0.02 * x, "plane")
    # the quantile leaves out the highest roughness; a plane takes up to 2 % of grooves of which few are seen, 1/periods^2
    for part in (0.001, 0.02):
        high, low = np.quantile(z, (1.0 - part, part)), np.quantile(before, (1.0 - part, part))
        assert np.ptp(high) == pytest.approx(np.ptp(low), rel=0.02)
    number, cosine = (0, math.sin(direction)) if angle == 90 else (1, math.cos(direction))
    rows = resample(np.moveaxis(z, number, 1)[::10], 16 * z.shape[number], axis=1)
    apart = np.concatenate([np.diff(find_peaks(row, prominence=0.15e-6)[0]) for row in rows])
    assert np.median(apart) * surface.spacing[1 - number] / 16.0 == pytest.approx(wavelength / cosine, rel=0.02)


def test_copies_fit_grooves_or_a_domain_that_does_is_named():
    y, x = np.mgrid[0:200, 0:300] * 0.5e-6
    grooves = HeightMap(0.2e-6 * np.cos(2.0 * np.pi * x / 10e-6), (0.5e-6,) * 2, "")  # 15 of them, 10 um apart
    # half a groove is left over of 105 um, and of two copies of 210 um, whereas three have 7 grooves each
    surface = periodic_scan(grooves, (105e-6, 80e-6), ScanOptions("mean"))
    assert re.search(r"along x .* \(correlation -1.00\): a domain of 1[01]0 um instead of 105 um would", surface.notes[-1])
    surface = periodic_scan(grooves, (210e-6, 80e-6), ScanOptions("mean"))
    assert surface.copies == (3, 1) and len(surface.notes) == 1
    # the spline through 20 points per groove: 1e-4, and the grid need not have a point on a crest
    assert surface.heights.max() == pytest.approx(0.2e-6, rel=2e-3)
    assert np.abs(np.fft.rfft(surface.heights[0])).argmax() == 21


def test_a_map_that_is_periodic_is_read_back(tmp_path):
    given = plate_surfaces(scene({"rms": 2e-7, "long": 2e-5, "short": 4e-6}))["lower"]
    np.savez(tmp_path / "map.npz", heights=given.heights, spacing=given.spacing, unit="m")
    lower = {"file": str(tmp_path / "map.npz"), "join": "periodic"}
    again = plate_surfaces(scene(lower))["lower"]
    assert np.abs(again.heights - given.heights).max() <= 1e-12 * given.statistics.rms_height
    assert "1 x 1 periods of 100 um by 80 um" in again.notes[-1]
    # the filter leaves waves from 1.5 times its length on, and the transform knows no edges: rounding only
    twice = plate_surfaces(scene(lower | {"short": 2e-6}, size=(200e-6, 80e-6)))["lower"]
    assert twice.copies == (2, 1)
    step = twice.heights.shape[1] // 2 // given.heights.shape[1], twice.heights.shape[0] // given.heights.shape[0]
    np.testing.assert_allclose(twice.one_copy[:: step[1], :: step[0]], given.heights, atol=1e-12 * 0.2e-6)
    with pytest.raises(InputError, match="100 um by 80 um, which does not fit .* of 120 um by 80 um.*; 100 um by 80 um would"):
        plate_surfaces(scene(lower, size=(120e-6, 80e-6)))
    holes = given.heights.copy()
    holes[:6, :6], holes[-6:, -6:] = np.nan, np.nan  # over the seams
    filled = periodic_scan(HeightMap(holes, given.spacing, ""), SIZE, ScanOptions(join="periodic"))
    assert filled.statistics.max_slope < 1.2 * given.statistics.max_slope
    error = faults_of(lower | {"level": "plane", "crop": {"x": [0.0, 5e-5]}})
    assert [fault.key.rpartition(".")[2] for fault in error.faults] == ["crop", "level"]


def test_the_inside_of_a_scan_is_left_as_it_is():
    # no wave shorter than 4 um: a filter at 2.5 um, which passes from 3.75 um on, must change nothing; mirror keeps every point
    original = scan()
    surface = periodic_scan(original, (200e-6, 160e-6), ScanOptions("mean", short=2.5e-6, join="mirror"))
    assert surface.copies == (1, 1)
    # four points of the file by default; 150 um by 120 um less the tenth of the blend; a part along x
    other = periodic_scan(original, (137e-6, 218e-6), ScanOptions("mean"))
    assert (other.shortest, other.copies) == (pytest.approx(2e-6), (2, 3))
    assert np.array_equal(cropped(original, ((10e-6, 60e-6), None)).heights, original.heights[:, 20:121])
    x = np.arange(40, 160) * surface.spacing[0] / original.spacing[0]
    y = np.arange(40, 120) * surface.spacing[1] / original.spacing[1]
    expected = map_coordinates(original.heights, np.meshgrid(y, x, indexing="ij"), order=3)
    difference = surface.heights[40:120, 40:160] - expected
    # 8 points per shortest wave and the kink of the tilt at the seam, whose trace falls off within some wavelengths
    assert np.ptp(difference) < 0.01 * 0.2e-6


def test_missing_points_are_filled_or_refused():
    whole = scan()
    holes = whole.heights.copy()
    holes[100:110, 50:60] = np.nan
    holes[np.random.default_rng(1).random(holes.shape) < 0.01] = np.nan
    filled = fill_missing(holes)
    lost = np.isnan(holes)
    assert not np.isnan(filled).any() and np.array_equal(filled[~lost], holes[~lost])
    assert (filled - whole.heights)[lost].std() < 0.2 * 0.2e-6  # holes of 5 um, a quarter of the long wavelength
    part = HeightMap(holes, whole.spacing, "scan.npz")
    notes = periodic_scan(part, (100e-6, 100e-6), ScanOptions(short=4e-6)).notes
    assert "had no height and were filled" in notes[0]
    with pytest.raises(InputError, match="of the points have no height; at most 0.5"):
        periodic_scan(part, (100e-6, 100e-6), ScanOptions(short=4e-6, missing=0.005))
    holes[:90, :90] = whole.heights[:90, :90]  # of a part without holes none are missing
    options = ScanOptions(short=4e-6, missing=0.0, crop=((0.0, 40e-6), (0.0, 40e-6)))
    notes = periodic_scan(HeightMap(holes, whole.spacing, ""), (40e-6, 40e-6), options).notes
    assert not any("no height" in note for note in notes)
    # levelling takes away what it says
    y, x = np.mgrid[0:30, 0:40] * 1e-6
    plane, curved = 2e-6 + 0.3 * x - 0.1 * y, 100.0 * x**2 - 50.0 * x * y
    assert np.abs(levelled(plane, "plane")).max() < 1e-18
    twist = 50.0 * (x - x.mean()) * (y - y.mean())  # no plane, so it stays
    assert levelled(plane + twist, "plane") == pytest.approx(twist, rel=0.0, abs=1e-18)
    assert np.abs(levelled(plane + curved, "curved")).max() < 1e-18
    assert np.ptp(levelled(plane, "mean")) == pytest.approx(np.ptp(plane), rel=1e-12)


FAULTS = {
    "not periodic": ({"wave": {"amplitude": 1e-7, "wavelength": 20e-6}}, {"periodic": False}, "domain.periodic must be true"),
    "no whole waves": ({"wave": {"amplitude": 1e-7, "wavelength": 30e-6}}, {},
                       'nearest: 3 along x and 0 along y: wavelength = "33.3333 um"'),
    "long": ({"rms": 1e-7, "long": 90e-6, "short": 4e-6}, {}, "at most the smaller side of the domain, 80 um"),
    "short": ({"rms": 1e-7, "long": 9e-6, "short": 9e-6}, {}, "must be less than long, 9 um"),
    "grid": ({"rms": 1e-7, "long": 9e-6, "short": 9e-9}, {}, "at most 3e+07 in all"),
    "hurst": ({"rms": 1e-7, "hurst": 1.2, "long": 9e-6, "short": 4e-6}, {}, "1.2 must be greater than 0 and at most 1"),
    "two kinds": ({"rms": 1e-7, "wave": []}, {}, "give one of rms, wave, file"),
    "no kind": ({"height": 1e-7}, {}, "give one of rms, wave, file"),
    "wide flanks": ({"wave": {"depth": 5e-6, "width": 6e-6, "flank": math.radians(45), "wavelength": 20e-6}}, {}, "at most 3 um"),
}  # fmt: skip


@each(FAULTS)
def test_faults_of_a_surface_name_what_is_allowed(case):
    surface, domain, text = FAULTS[case]
    error = str(faults_of(surface, **domain))
    assert text in error and "plates.lower.surface" in error


def test_all_faults_of_both_plates_come_at_once(tmp_path):
    upper = {"wave": [{"amplitude": 1e-7, "wavelength": 20e-6}, {"amplitude": 1.0}]}
    keys = {fault.key for fault in faults_of({"rms": -1e-7, "long": 9e-6, "shrt": 4e-6}, upper).faults}
    assert keys == {"plates.lower.surface.rms", "plates.lower.surface.shrt", "plates.upper.surface.wave[1].wavelength"}
    # a scene with surfaces is saved and read again
    groove = {"depth": 1e-6, "width": 6e-6, "flank": math.radians(30), "wavelength": 20e-6}
    wave = [groove, {"amplitude": 1e-7, "wavelength": 16e-6, "direction": "y"}]
    given = scene({"wave": wave}, {"file": "scan.npz", "crop": {"x": [0.0, 5e-5]}, "curvature": False})
    np.savez(tmp_path / "scan.npz", heights=scan().heights, spacing=0.5e-6, unit="m")
    given.save(tmp_path / "scene.toml")
    assert Scene.load(tmp_path / "scene.toml") == given
    lower, upper = plate_surfaces(Scene.load(tmp_path / "scene.toml")).values()
    assert lower.shortest == pytest.approx(0.4e-6 * math.sqrt(3.0), rel=1e-12) and not upper.curvature  # a corner's two halves
    assert given.plates.lower.surface.wave[0].corner() == pytest.approx(
        0.2e-6 * math.sqrt(3.0), rel=1e-12
    )  # by default a fifth of the flank


def test_a_scan_that_changed_stops_a_resumed_run():
    waves = [{"amplitude": amplitude, "wavelength": 20e-6} for amplitude in (1e-7, 1.001e-7)]
    prints = [prints_of(build(scene({"wave": wave}))) for wave in waves]
    different = {key for key in prints[0] if prints[0][key] != prints[1][key]}
    assert different == {"the surfaces of the plates", "the bodies at the start"}  # they are placed on the surface
