"""Effective moduli of two elastic half-spaces in contact (Willert, Eqs. 3, 4, 14)."""

from thirdbody.laws.contract import Material


def e_star(a: Material, b: Material) -> float:
    """E* [Pa]: 1/E* = (1 - nu_a)/(2 G_a) + (1 - nu_b)/(2 G_b) (Willert, Eq. 4)."""
    return 1.0 / ((1.0 - a.poisson_ratio) / (2.0 * a.shear_modulus) + (1.0 - b.poisson_ratio) / (2.0 * b.shear_modulus))


def g_star(a: Material, b: Material) -> float:
    """G* [Pa]: 1/G* = (2 - nu_a)/(4 G_a) + (2 - nu_b)/(4 G_b) (Willert, Eq. 14); four times the G_eff of most DEM codes."""
    return 1.0 / ((2.0 - a.poisson_ratio) / (4.0 * a.shear_modulus) + (2.0 - b.poisson_ratio) / (4.0 * b.shear_modulus))


def dundurs_beta(a: Material, b: Material) -> float:
    """Dundurs' second parameter: zero if the pair is elastically similar (Willert, Eq. 3), as Hertz-Mindlin assumes."""
    x, y = (1.0 - 2.0 * a.poisson_ratio) / a.shear_modulus, (1.0 - 2.0 * b.poisson_ratio) / b.shear_modulus
    s, t = (2.0 - 2.0 * a.poisson_ratio) / a.shear_modulus, (2.0 - 2.0 * b.poisson_ratio) / b.shear_modulus
    return (x - y) / (s + t)
