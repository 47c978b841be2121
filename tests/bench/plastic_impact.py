"""Rebound of two equal balls that yield in LAMMPS (`mdr`), against its own law and against that of `elastic_plastic`, undamped.

`python tests/bench/plastic_impact.py LMP` with the program of LAMMPS (`tests/bench/neck_impact.py` says how to get it). It has no
law of Thornton and Ning. Its nearest is that of Zunker and Kamrin 2024 (J. Mech. Phys. Solids 183, 105492): Hertz up to a mean
pressure p, 2.75 times the yield strength in shallow dents, then p on an area of slope 2 pi R, while here the peak of Hertz'
pressure is cut off and the slope is pi R. With p_y = 1.5 p both yield at one overlap, and so at one speed V_y. Beyond, the area
of LAMMPS is larger at one overlap: its balls dent less and give back less.
"""

import math
import subprocess
import sys
import tempfile
from pathlib import Path

MODULUS, POISSON, DENSITY, RADIUS, STRENGTH = 210e9, 0.3, 7850.0, 1e-6, 1e9
STAR = MODULUS / (1.0 - POISSON**2)
"""E* of a ball on a rigid plane, which the plane of symmetry is."""
MASS = 4.0 / 3.0 * math.pi * RADIUS**3 * DENSITY
FIRST = RADIUS * (3.0 * math.pi * 2.75 * STRENGTH / (4.0 * STAR)) ** 2
"""Overlap of a ball with that plane at first yield."""

SCRIPT = """
units micro
atom_style sphere
boundary f f f
newton off
atom_modify map array
comm_modify vel yes
region box block -5 5 -5 5 -5 5
create_box 1 box
create_atoms 1 single 0 0 {place!r}
create_atoms 1 single 0 0 -{place!r}
set type 1 diameter 2 density 7.85
group up id 1
group down id 2
velocity up set 0 0 -{speed!r}
velocity down set 0 0 {speed!r}
pair_style granular
pair_coeff * * mdr {modulus!r} {poisson!r} {strength!r} 0.0 0.5 0.0 tangential linear_history 0.0 0.0 0.0 damping mdr 1
neighbor 0.5 bin
fix move all nve/sphere
timestep {step!r}
thermo 100000000
run {count}
variable rebound equal vz[1]
print "REBOUND ${{rebound}}"
"""
"""Micrometres, picograms, microseconds: pressures in kPa."""


def rebound(program: str, speed: float, steps: int) -> float:
    """Return the speed of the rebound over that of the impact, with so many steps in the contact time of elastic balls."""
    step = 2.868 * (MASS**2 / (RADIUS * STAR**2 * speed)) ** 0.2 / steps
    values = {
        "place": 1.0 + 0.3e6 * speed * step, "speed": speed, "step": 1e6 * step, "count": 3 * steps,
        "modulus": 1e-3 * MODULUS, "poisson": POISSON, "strength": 1e-3 * STRENGTH,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "in.lammps"
        file.write_text(SCRIPT.format(**values), encoding="utf-8")
        done = subprocess.run([program, "-in", str(file), "-log", "none"], capture_output=True, text=True, check=True, cwd=folder)
    return float(next(line for line in done.stdout.splitlines() if line.startswith("REBOUND")).split()[1]) / speed


def yield_energy() -> float:
    """Elastic energy [J] of a ball at first yield."""
    return 8.0 / 15.0 * STAR * math.sqrt(RADIUS) * FIRST**2.5


def flattened(overlap: float) -> tuple[float, float]:
    """Pressure [Pa] and squared contact radius [m2] of LAMMPS' yielding contact."""
    pressure = STRENGTH * (1.75 * math.exp(-4.4 * overlap / RADIUS) + 1.0)
    return pressure, 2.0 * overlap * RADIUS - overlap**2 - FIRST * (RADIUS - FIRST)


def own_law(ratio: float) -> float:
    """Restitution of LAMMPS' law at V/V_y > 1: work up to the largest overlap, and what its elliptical indenter gives back."""
    work, wanted, overlap = yield_energy(), ratio**2 * yield_energy(), FIRST
    step = FIRST / 2000.0
    pressure, square = flattened(overlap)
    while work < wanted:
        before, overlap = pressure * square, overlap + step
        pressure, square = flattened(overlap)
        work += 0.5 * math.pi * (before + pressure * square) * step
    a, elastic = math.sqrt(square), 2.0 * pressure * math.sqrt(square) / STAR
    height = RADIUS - (overlap - elastic)
    slant = math.sqrt(square + height**2)
    sunk = -2.0 * square * (1.0 - POISSON) + (1.0 - 2.0 * POISSON) * height * (slant - height)
    sunk *= pressure / (MODULUS / (1.0 + POISSON)) / slant  # correction of the unloaded displacement
    return math.sqrt(8.0 / 3.0 * pressure**2 * a**3 / STAR * (1.0 + sunk / elastic) / work)


def thornton(ratio: float) -> float:
    """Restitution of Thornton 1997, Eq. 25, which `tests/theory/test_elastic_plastic.py` holds us against."""
    y = 1.0 / ratio
    return math.sqrt(1.2 * math.sqrt(3.0) * (1.0 - y * y / 6.0)) * (y / (y + 2.0 * math.sqrt(1.2 - 0.2 * y * y))) ** 0.25


def main() -> None:
    """Print the table."""
    first = math.sqrt(2.0 * yield_energy() / MASS)
    print(f"V_y = {first:.4f} m/s; columns: V/V_y, LAMMPS with 400 and 1600 steps, its own law, Thornton")
    for ratio in (0.9, 1.1, 2.0, 5.0, 10.0, 100.0):
        found = [rebound(sys.argv[1], ratio * first, steps) for steps in (400, 1600)]
        laws = (own_law(ratio), thornton(ratio)) if ratio > 1.0 else (1.0, 1.0)
        print(f"{ratio:g}: {found[0]:.5f} {found[1]:.5f} {laws[0]:.5f} {laws[1]:.5f}")


if __name__ == "__main__":
    main()
