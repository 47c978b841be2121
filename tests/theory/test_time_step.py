"""The longest stable step against the amplification of the scheme itself, written out for one oscillator."""

import numpy as np
from each import each

from thirdbody.kernels.explicit.critical_time_step import stable_step


def growth(omega: float, rate: float, dt: float) -> float:
    """Spectral radius of one step of velocity Verlet; the dashpot sees v + dt a, predicted from the force before."""
    w, g = (omega * dt) ** 2, rate * dt
    # x, v dt, a dt^2: drift, new acceleration, closing half kick
    drift = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    force = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-w, -g, -0.5 * g]])
    kick = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    return float(np.abs(np.linalg.eigvals(kick @ force @ drift)).max())


@each([(1.0, 0.0), (1.0, 0.1), (1.0, 1.0), (1.0, 4.0), (1.0, 100.0), (1e-3, 1.0)])
def test_the_stable_step_is_the_edge_of_stability(row):
    omega, rate = row
    limit = stable_step.py_func(omega**2, rate)
    # undamped the scheme is neutral below the limit: rounding of the double eigenvalue is 1e-8
    assert growth(omega, rate, 0.999 * limit) <= 1.0 + 1e-7
    assert growth(omega, rate, 1.001 * limit) > 1.0 + 1e-4
