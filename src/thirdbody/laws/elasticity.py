"""Effective moduli of two elastic half-spaces in contact (Willert, Eqs. 3, 4, 14)."""

from thirdbody.laws.contract import Material


def e_star(a: Material, b: Material) -> float:
    """Effective modulus of normal contact: 1/E* = (1 - nu_a)/(2 G_a) + (1 - nu_b)/(2 G_b).

    Parameters
    ----------
    a, b : Material
        The two bodies.

    Returns
    -------
    float
        E* [Pa].

    Source
    ------
    E. Willert, Self-consistency conditions in static three-body elastic tangential contact, Eq. 4.

    Examples
    --------
    >>> steel = plugin.Material("steel", shear_modulus=80e9, poisson_ratio=0.3, density=7850.0)
    >>> f"{plugin.e_star(steel, steel):.4e}"
    '1.1429e+11'
    """
    return 1.0 / ((1.0 - a.poisson_ratio) / (2.0 * a.shear_modulus) + (1.0 - b.poisson_ratio) / (2.0 * b.shear_modulus))


def g_star(a: Material, b: Material) -> float:
    """Effective modulus of tangential contact: 1/G* = (2 - nu_a)/(4 G_a) + (2 - nu_b)/(4 G_b).

    Parameters
    ----------
    a, b : Material
        The two bodies.

    Returns
    -------
    float
        G* [Pa], four times the G_eff of most DEM codes.

    Source
    ------
    E. Willert, Self-consistency conditions in static three-body elastic tangential contact, Eq. 14.
    """
    return 1.0 / ((2.0 - a.poisson_ratio) / (4.0 * a.shear_modulus) + (2.0 - b.poisson_ratio) / (4.0 * b.shear_modulus))


def dundurs_beta(a: Material, b: Material) -> float:
    """Dundurs' second parameter: zero if the pair is elastically similar, as Hertz-Mindlin assumes.

    Parameters
    ----------
    a, b : Material
        The two bodies.

    Returns
    -------
    float
        beta = ((1-2 nu_a)/G_a - (1-2 nu_b)/G_b)/(2 (1-nu_a)/G_a + 2 (1-nu_b)/G_b).

    Source
    ------
    E. Willert, Self-consistency conditions in static three-body elastic tangential contact, Eq. 3; Johnson 1985, Eq. 5.3.
    """
    x, y = (1.0 - 2.0 * a.poisson_ratio) / a.shear_modulus, (1.0 - 2.0 * b.poisson_ratio) / b.shear_modulus
    s, t = (2.0 - 2.0 * a.poisson_ratio) / a.shear_modulus, (2.0 - 2.0 * b.poisson_ratio) / b.shear_modulus
    return (x - y) / (s + t)
