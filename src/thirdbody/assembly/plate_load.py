"""Direct contact of the plates, which carries a part of their load, and the words for first yield."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from thirdbody import units
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.engine.upper_plate import GapLaw
from thirdbody.errors import InputError
from thirdbody.laws.hertz import e_star
from thirdbody.scene.model import Scene
from thirdbody.surfaces.surface import Surface
from thirdbody.units import pretty

Array = NDArray[np.float64]

GAMMA = 0.45
"""Part of the elastic energy of full contact that is stored in partial contact: C. Yang and B. N. J. Persson, J. Phys.: Condens.
Matter 20:215214 (2008)."""

EULER = 0.5772156649015329

FULL_CONTACT = 0.407124934634389
"""Integral of erf(x)^2 exp(-x^2)/x over all x > 0: what the transition to full contact adds."""


def times(ratio: float) -> str:
    """Return the words for a ratio to what follows."""
    return "equal to" if f"{ratio:.2g}" == "1" else f"{ratio:.2g} times"


def limit_words(material: str, pressure: float, strength: float, assumed: bool) -> str:
    """Describe first yield of a material: its peak pressure [Pa], and the yield strength [Pa]."""
    source = f"assumed as E/100: materials.{material}.yield_strength is not given" if assumed else "given"
    shown = pretty(strength, "pressure")
    return f"first yield of {material} at {pretty(pressure, 'pressure')} (yield strength {shown}, {source})"


def direct_contact(scene: Scene, choice: CompiledPhysics, surfaces: Mapping[str, Surface]) -> GapLaw | None:
    """Return the direct contact of the plates, None without. Raises InputError where nothing gives its parameters."""
    given, upper, lower = scene.plates.contact, scene.plates.upper, scene.plates.lower
    if given is None or (upper is not None and upper.profile is not None):
        return None
    assert upper is not None and lower is not None
    if given.beta is not None and given.u0 is not None:
        beta, length = given.beta, given.u0
    else:
        try:
            beta, length = persson_parameters([surface.heights for surface in surfaces.values()], scene.domain.size)
        except ValueError:
            message = "needs beta and u0: both plates are flat, so nothing estimates them"
            raise InputError(scene.fault(("plates", "contact"), message)) from None
    materials = dict(zip(scene.materials, choice.materials, strict=True))
    modulus = e_star(materials[lower.material], materials[upper.material])
    area = scene.domain.size[0] * scene.domain.size[1]
    return GapLaw(beta * modulus * area, length, given.friction)


def narrow_gap_warning(direct: GapLaw | None, gap: float) -> list[str]:
    """Return a warning where the mean gap [m] under the largest load is below u0: the law holds for small contact areas."""
    if direct is None or gap >= direct.length:
        return []
    return [
        f"the gap under the largest load, {units.pretty(gap, 'length')}, is below plates.contact.u0, "
        f"{units.pretty(direct.length, 'length')}: the exponential law of direct contact holds for wider gaps"
    ]


def persson_parameters(heights: Sequence[Array], size: tuple[float, float]) -> tuple[float, float]:
    """Return beta and u_0 [m] of two surfaces, from their heights (n_y, n_x) [m] on grids that cover the periodic domain.

    p = beta E* exp(-u/u_0) for a contact area that is a small part of the whole. With the spectrum C(q) of the sum of both
    surfaces, from the smallest wavenumber on, and w(q) = (pi integral of q^3 C)^(-1/2) up to q:

        u_0 = sqrt(pi) gamma integral of q^2 C w
        ln beta = -(integral of q^2 C w ln w)/(integral of q^2 C w) - Euler/2 + 3 (1 - gamma)/gamma integral of erf^2 exp(-x^2)/x

    B. N. J. Persson, PRL 99:125502 (2007), with the factor gamma + 3 (1 - gamma) P^2 of the elastic energy of Yang and Persson
    (2008). Surfaces that are not correlated: their spectra add. Raises ValueError for surfaces that are flat.
    """
    if not any(np.ptp(z) > 0.0 for z in heights):
        raise ValueError("flat surfaces have no spectrum")
    q, power = (np.concatenate(parts) for parts in zip(*(_spectrum(z, size) for z in heights), strict=True))
    # wavenumbers in rising order, each once, and the sums over their modes; modes equal but for rounding are one
    scale = float(q.min())
    numbers, shell = np.unique(np.round(q / scale, 9), return_inverse=True)
    q, power = numbers * scale, np.bincount(shell, power).astype(np.float64)
    slopes = q * q * power
    # half of the mean squared slope up to q; a mode counts half at its own wavenumber
    w = 1.0 / np.sqrt(0.5 * np.maximum(np.cumsum(slopes) - 0.5 * slopes, 1e-300))
    weight = q * power * w / (2.0 * np.pi)
    total = float(weight.sum())
    ln_beta = -float(weight @ np.log(w)) / total - 0.5 * EULER + 3.0 * (1.0 - GAMMA) / GAMMA * FULL_CONTACT
    return float(np.exp(ln_beta)), float(np.sqrt(np.pi)) * GAMMA * total


def _spectrum(z: Array, size: tuple[float, float]) -> tuple[Array, Array]:
    """Return the wavenumbers [1/m] of all modes of a periodic surface but the mean, and their mean squared heights [m2]."""
    n_y, n_x = z.shape
    modes = np.abs(np.fft.fft2(z) / z.size) ** 2
    q_x, q_y = 2.0 * np.pi * np.fft.fftfreq(n_x, size[0] / n_x), 2.0 * np.pi * np.fft.fftfreq(n_y, size[1] / n_y)
    return np.hypot(*np.meshgrid(q_x, q_y)).ravel()[1:], modes.ravel()[1:]
