"""What `check` says of rough plates: curvature against spheres, contact radius against wavelengths, steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from thirdbody.assembly.surface_scales import MERGING, NARROW, NOTICED, surface_scales
from thirdbody.report.plates import print_rough_plates
from thirdbody.surfaces.surface import Surface
from thirdbody.surfaces.waves import phases, sine_heights

WAVELENGTH, RADIUS = 20e-6, 5e-6


def wavy(amplitude: float, wavelength: float = WAVELENGTH) -> Surface:
    return Surface(sine_heights(phases((8, 128), (4, 0), 0.0), amplitude), (4.0 * wavelength, wavelength), wavelength)


def test_a_sphere_touches_at_several_points_where_a_valley_is_sharper():
    critical = 1.0 / (RADIUS * (2.0 * math.pi / WAVELENGTH) ** 2)  # amplitude at which 1/curvature is the radius
    for factor, several in ((0.9, False), (1.1, True)):
        scales = surface_scales({"lower": wavy(factor * critical)}, RADIUS, 1e-4)["lower"]
        assert scales.valley == pytest.approx(factor, rel=0.005)  # the spline of 32 points: 0.32 %
        assert scales.document()["several_contacts"] is several
        assert not scales.warnings("lower")


def test_energy_of_contacts_that_become_one_is_reported(capsys):
    sharp = wavy(1.1 / (RADIUS * (2.0 * math.pi / WAVELENGTH) ** 2))
    limit = NOTICED * WAVELENGTH / (MERGING * RADIUS)  # overlap over radius
    for overlap, count in ((0.9 * limit, 0), (1.1 * limit, 1)):
        scales = surface_scales({"lower": sharp}, RADIUS, overlap)["lower"]
        assert scales.document()["energy_of_merging_contacts_over_load"] == pytest.approx(MERGING * overlap * RADIUS)
        assert sum("become one, energy is made or lost" in text for text in scales.warnings("lower")) == count
    print_rough_plates({"lower": scales.document()})
    text = capsys.readouterr().out.replace("\N{NO-BREAK SPACE}", " ")
    assert "at most that of the load along 66 nm" in text
    assert surface_scales({"lower": wavy(1e-9)}, RADIUS, limit)["lower"].merging == 0.0


def test_contacts_that_are_wide_against_the_waves_give_a_warning():
    for factor, count in ((0.9, 0), (1.1, 1)):
        overlap = (factor * NARROW * WAVELENGTH / RADIUS) ** 2
        scales = surface_scales({"lower": wavy(1e-9)}, RADIUS, overlap)["lower"]
        assert scales.width == pytest.approx(factor * NARROW)
        assert len(scales.warnings("lower")) == count
    assert "11 % of the shortest wavelength (20 um)" in scales.warnings("lower")[0].replace("\N{NO-BREAK SPACE}", " ")


def test_a_contact_on_a_crest_is_narrower_by_the_third_root():
    scales = surface_scales({"upper": wavy(3e-6)}, RADIUS, 1e-2)["upper"]
    ratio = 1.0 + RADIUS * scales.statistics.crest_curvature
    assert scales.crest_contact_radius == pytest.approx(0.1 * RADIUS / ratio ** (1.0 / 3.0), rel=1e-12)
    assert "of that of the sharpest crest" in scales.warnings("upper")[0]


def test_steps_are_noticed_and_nothing_is_said_of_an_unknown_load(capsys):
    step = np.where(np.arange(128) < 64, 1e-6, -1e-6)[None, :] * np.ones((8, 1))
    scales = surface_scales({"lower": Surface(step, (40e-6, 20e-6), 20e-6)}, RADIUS, 0.0)["lower"]
    assert "does the file hold steps?" in scales.warnings("lower")[0]
    assert scales.document()["contact_radius"] is None
    print_rough_plates({"lower": scales.document()})
    text = capsys.readouterr().out
    assert "lower plate: rms height 1 um" in text and "contact radius" not in text and "several points" in text


def test_flat_plates_have_no_scales():
    assert surface_scales({}, RADIUS, 1e-4) == {}
