"""Closed forms of contact mechanics, impact and rigid-body motion: references that share no code with a law.

Plain floats in, plain floats out, SI units; signs and moduli as in `three_spot_theory`."""

import math
from collections.abc import Sequence

from scipy.special import ellipk
from three_spot_theory import contact_radius, hertz_force


def hertz_stiffness(e: float, radius: float, overlap: float) -> float:
    return 2.0 * e * contact_radius(radius, overlap)


def mindlin_loading(s: float, limit: float, s_c: float) -> float:
    """First loading at constant N: T = mu N [1 - (1 - s/s_c)^1.5] [N], `limit` = mu N beyond s_c (Cattaneo, Mindlin)."""
    return limit * (1.0 - max(1.0 - s / s_c, 0.0) ** 1.5)


def mindlin_reversal(s: float, s_reversal: float, limit: float, s_c: float) -> float:
    """T [N] after reversal at s*: T* - 2 mu N [1 - (1 - (s* - s)/(2 s_c))^1.5], s >= s* - 2 s_c (Mindlin, Deresiewicz 1953)."""
    return mindlin_loading(s_reversal, limit, s_c) - 2.0 * mindlin_loading((s_reversal - s) / 2.0, limit, s_c)


def mindlin_loop_work(force_ratio: float) -> float:
    """Work lost in a loop between +-T* over mu N s_c, for tau = T*/(mu N) in [0, 1]. (24/5) {1 - (1-tau)^(5/3) - (5 tau/6) [1 +
    (1-tau)^(2/3)]} (Mindlin and Deresiewicz 1953)."""
    tau, stick = force_ratio, 1.0 - force_ratio
    return 24.0 / 5.0 * (1.0 - stick ** (5.0 / 3.0) - 5.0 * tau / 6.0 * (1.0 + stick ** (2.0 / 3.0)))


def impact_overlap(mass: float, radius: float, e: float, speed: float) -> float:
    """Maximum overlap of an elastic Hertz impact [m]: (15 m v^2/(16 E* sqrt R))^(2/5); reduced m, R."""
    return (15.0 * mass * speed**2 / (16.0 * e * math.sqrt(radius))) ** 0.4


def impact_force(mass: float, radius: float, e: float, speed: float) -> float:
    """Maximum force of an elastic Hertz impact [N] (Chung and Ooi 2011)."""
    return hertz_force(e, radius, impact_overlap(mass, radius, e, speed))


def impact_duration(mass: float, radius: float, e: float, speed: float) -> float:
    """Contact time t_c [s]: 2 sqrt(pi) Gamma(7/5)/Gamma(9/10) d_max/v = 2.868 (m^2/(R E*^2 v))^(1/5)."""
    shape = 2.0 * math.sqrt(math.pi) * math.gamma(1.4) / math.gamma(0.9)
    return shape * impact_overlap(mass, radius, e, speed) / speed


def gross_slip_speed_ratio(mu: float, restitution: float, angle: float) -> float:
    """v_t'/v_t of a sphere on a plane: 1 - mu (1+e)/tan(angle), `angle` from the normal (Chung and Ooi 2011, test 4)."""
    return 1.0 - mu * (1.0 + restitution) / math.tan(angle)


def gross_slip_spin(mu: float, restitution: float, angle: float, speed: float, radius: float) -> float:
    """Spin after a gross-slip impact, zero before [rad/s]: -(5/2) mu (1+e) V cos(angle)/R (Chung and Ooi 2011, test 4)."""
    return -2.5 * mu * (1.0 + restitution) * speed * math.cos(angle) / radius


def gross_slip_tangential_restitution(mu: float, restitution: float, v_n: float, v_slip: float) -> float:
    """beta = -1 + 3.5 mu (1+e) v_n/v_st of a solid sphere in gross slip (Chung and Ooi 2011, test 6)."""
    return -1.0 + 3.5 * mu * (1.0 + restitution) * v_n / v_slip


def maw_chi(nu: float) -> float:
    """chi = 7 (1-nu)/(2 (2-nu)) of a solid sphere of like material (Maw, Barber and Fawcett 1976)."""
    return 3.5 * (1.0 - nu) / (2.0 - nu)


def maw_gross_slip(psi: float, chi: float) -> float:
    """Rebound angle psi_2 = psi_1 - 4 chi for psi_1 >= 4 chi - 1, where the whole impact slips."""
    assert psi >= 4.0 * chi - 1.0, "the contact sticks for a while: there is no closed form"
    return psi - 4.0 * chi


def slope_sphere_rolls(mu: float, g_t: float, g_n: float) -> bool:
    """Return whether a solid sphere released on a slope rolls without slip: mu >= (2/7) g_t/g_n."""
    return mu >= 2.0 / 7.0 * g_t / g_n


def sliding_sphere(mu: float, g_t: float, g_n: float, radius: float, time: float) -> tuple[float, float]:
    """(speed [m/s], spin [rad/s]) of a sphere that slips down a slope: (g_t - mu g_n) t, (5/2) mu g_n t/R."""
    return (g_t - mu * g_n) * time, 2.5 * mu * g_n * time / radius


def pinched_sphere_slip_time(mass: float, mu: float, force: float, plate_speed: float) -> float:
    """Time for which a sphere between plates slips on the upper one, suddenly at V [s]: 7 m V/(20 mu N)."""
    return 7.0 * mass * plate_speed / (20.0 * mu * force)


def pinched_sphere_rolling(plate_speed: float, radius: float) -> tuple[float, float]:
    """(speed V/2, spin V/(2 R)) of a sphere that rolls between a resting plate and one at V; T = 0."""
    return plate_speed / 2.0, plate_speed / (2.0 * radius)


def stopped_sphere(mu: float, rub: float) -> tuple[float, float, float]:
    """(tangential and normal force of the lower plate, push on the obstacle) over the load of a sphere that an obstacle stops.
    It slips on the upper plate, which drags it by mu; the obstacle, at the height of its centre, carries `rub` of its load by
    friction. Moments about the centre: mu = T + rub; forces: N = 1 - rub, push = mu + T. By statics alone `rub` is any value
    that friction at the obstacle allows: 0 <= rub <= mu' push, so 2 mu/(1 + mu') <= push <= 2 mu."""
    return mu - rub, 1.0 - rub, 2.0 * mu - rub


def second_of_two_stopped_spheres(mu: float, rubs: tuple[float, float]) -> tuple[float, float, float]:
    """The same of the sphere behind which another one waits; `rubs`: friction between the two, and at the obstacle. At rest the
    first rubs up on neither: it hangs on the second by rubs[0], which turns both the same way."""
    behind, ahead = rubs
    lower = mu - behind - ahead
    return lower, 1.0 + behind - ahead, stopped_sphere(mu, behind)[2] + mu + lower


def sphere_turning_on_the_spot(mu_lower: float, mu_obstacle: float) -> float:
    """Share of its load that an obstacle carries by friction, if the sphere rolls on the upper plate and slips everywhere else.
    T = mu_lower (1 - F) below, F = mu' P at the obstacle, P = 2 T + F by forces and moments."""
    slip = 2.0 * mu_obstacle * mu_lower
    return slip / (1.0 - mu_obstacle + slip)


def mounting_friction(low: float, high: float) -> float:
    """Friction at the upper plate and between them above which a sphere of radius `high` mounts one of radius `low`: the top of
    the one, where they touch, and the foot of the other lie on a line that meets all surfaces at one angle."""
    return math.sqrt(low / high)


def top_period(moments: Sequence[float], spin: Sequence[float]) -> float:
    """Period of the body-frame angular velocity of a torque-free top [s], 4 K(k) over the rate (Landau and Lifshitz I, section
    37). `moments` I_1 < I_2 < I_3, `spin` in the principal frame at some instant."""
    square = sum((i * o) ** 2 for i, o in zip(moments, spin, strict=True))
    twice_energy = sum(i * o**2 for i, o in zip(moments, spin, strict=True))
    i_1, i_2, i_3 = moments
    if square < twice_energy * i_2:  # circles the axis of least inertia: the formulas hold with 1 and 3 exchanged
        i_1, i_3 = i_3, i_1
    fast = (i_3 - i_2) * (square - twice_energy * i_1)
    slow = (i_2 - i_1) * (twice_energy * i_3 - square)
    return 4.0 * float(ellipk(slow / fast)) / math.sqrt(fast / (i_1 * i_2 * i_3))
