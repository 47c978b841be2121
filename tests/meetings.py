"""Scenes in which debris between two plates meets: few bodies, short ways, forces that statics knows.

All bodies are steel and carry `LOAD` each; what they do is a matter of the friction of the pairs, zero unless given. A *ball*
rolls at half the speed of the upper plate. A *post* is a flat clump that sticks to the lower plate, a *rider* one that the upper
plate carries, a *ridge* a post so low that a ball can mount it. Lengths in um."""

import itertools
import math
from dataclasses import dataclass, field, replace

STEEL = 'youngs_modulus = "210 GPa"\npoisson_ratio = 0.3\ndensity = "7850 kg/m3"\n'

R = 5.0  # radius of the balls, and of the spheres of posts and riders, um
LOAD = 1e-4  # on each body, N: the overlaps are a thousandth of the radius and less
SPEED = 0.2  # of the upper plate, m/s: balls come to rest within a tenth of a um after they have bounced
SETTLE = 2.5  # time under load before the upper plate moves, us
MU, GRIP, STUCK = 0.3, 0.5, 10.0  # friction of a ball with the upper and with the lower plate, and of what must not slip
HALF = 9.0  # distance of the first sphere of a post from its middle, um
GAP, START = 0.1, 15.0  # gap between bodies at the start, and place of the first one, um
RIDGE = 0.8  # radius of the spheres of a ridge, um: sqrt(RIDGE/R) is 0.4

Shape = tuple[tuple[float, float, float], ...]  # spheres x, y, radius, um; their centres are at one height
BALL: Shape = ((0.0, 0.0, R),)
POST: Shape = tuple((x, y, R) for x, y in ((-HALF, 0.0), (-4.5, 0.0), (0.0, -4.0), (0.0, 4.0), (4.5, 0.0), (HALF, 0.0)))
LOW: Shape = tuple((1.5 * k, 0.0, RIDGE) for k in range(-2, 3)) + tuple((0.0, 1.5 * k, RIDGE) for k in (-2, -1, 1, 2))


@dataclass(frozen=True)
class Meeting:
    """Bodies as (material, shape, x), frictions of pairs, motion of the upper plate, and when to stop and to look."""

    bodies: tuple[tuple[str, Shape, float], ...]
    friction: dict[tuple[str, str], float] = field(default_factory=dict)
    motion: str = f'{{velocity = "{SPEED} m/s"}}'
    end: str = 'distance = "2 um"'
    every: str = "0.4 um"
    restitution: float = 0.5

    def text(self, integrator: str) -> str:
        names = sorted({"base", "lid"} | {name for name, _, _ in self.bodies})
        tables = ["scene = 1", *(f"[materials.{name}]\n{STEEL}" for name in names)]
        for a, b in itertools.combinations_with_replacement(names, 2):
            mu = self.friction.get((a, b), self.friction.get((b, a), 0.0))
            tables.append(f'[[pairs]]\nbetween = ["{a}", "{b}"]\nfriction = {mu!r}\nrestitution = {self.restitution!r}')
        tables += [_debris(*body) for body in self.bodies]
        length = 40.0 + max(x for _, _, x in self.bodies)
        tables.append(
            f'[domain]\nsize = ["{length!r} um", "40 um"]\n[plates.lower]\nmaterial = "base"\n[plates.upper]\nmaterial = "lid"\n'
            f'support = "load_per_particle"\nload = "{LOAD!r} N"\nmotion = {{x = {self.motion}}}\n[solver]\n{self.end}\n'
            f'integrator = "{integrator}"\nsettle = "{SETTLE} us"\n[output]\nevery = "{self.every}"\n'
        )
        return "\n".join(tables)


def _debris(material: str, shape: Shape, x: float) -> str:
    spheres = ", ".join(f'{{center = ["{u!r} um", "{v!r} um", "0 um"], radius = "{r!r} um"}}' for u, v, r in shape)
    place = f'positions = [["{x!r} um", "20 um", "{shape[0][2]!r} um"]]'
    return f'[[debris]]\nkind = "spheres"\nmaterial = "{material}"\nshape = [{spheres}]\n{place}'


def against_post(balls: int, gap: float = GAP, **frictions: float) -> Meeting:
    """Balls that roll one behind the other towards a post; frictions as `ball_lid=0.3`, others as by default."""
    row = tuple(("ball", BALL, START + k * (2.0 * R + gap)) for k in range(balls))
    post = ("post", POST, START + balls * (2.0 * R + gap) + HALF)
    return Meeting((*row, post), _pairs({"ball_lid": MU, "ball_base": GRIP, "post_base": STUCK} | frictions))


def against_ridge(friction: float) -> Meeting:
    reach = 2.0 * math.sqrt(R * RIDGE) + GAP + 3.0
    bodies = (("ball", BALL, START), ("ridge", LOW, START + reach))
    pairs = {"ball_lid": friction, "ball_ridge": friction, "ball_base": GRIP, "ridge_base": STUCK}
    return Meeting(bodies, _pairs(pairs), '{velocity = "0.1 m/s"}', 'distance = "1 um"', "0.25 um")


def head_on(**frictions: float) -> Meeting:
    return Meeting((("rider", POST, START), ("post", POST, START + 2.0 * (R + HALF) + GAP)), _pairs(frictions))


def _pairs(frictions: dict[str, float]) -> dict[tuple[str, str], float]:
    return {(name.split("_")[0], name.split("_")[1]): mu for name, mu in frictions.items()}


# stroke, um, peak to peak, and period, us, of the upper plate in `lost_and_found`: eight outputs in a period
STROKE, PERIOD = 2.0, 8.0 * SETTLE

MEETINGS = {
    "two_that_touch": Meeting(
        (("ball", BALL, START), ("ball", BALL, START + 2.0 * R * (1.0 + 1e-12)), ("post", POST, START + 60.0)),
        _pairs({"ball_lid": MU, "ball_base": GRIP, "ball_ball": MU, "post_base": STUCK}),
    ),
    "stopped": replace(against_post(1, 0.4), end='distance = "3 um"'),
    "stopped_by_a_rough_post": against_post(1, ball_post=0.3),
    "turns_on_the_spot": against_post(1, ball_base=0.1, ball_post=0.3),
    "three_that_rub": against_post(2, ball_ball=0.3, ball_post=0.3),
    "chain_of_ten": replace(against_post(10, 0.02, ball_lid=0.05), restitution=0.2),
    "head_on": head_on(rider_lid=0.3, post_lid=0.1, post_base=STUCK, rider_post=0.3),
    "pushed_along": head_on(rider_lid=STUCK, post_base=0.5),
    "mounts": against_ridge(0.5),
    "held_by_a_ridge": against_ridge(0.3),
    "lost_and_found": replace(
        against_post(1), motion=f'{{stroke = "{STROKE} um", frequency = "{1e3 / PERIOD} kHz"}}',
        end=f'duration = "{2.0 * PERIOD} us"', every=f"{SETTLE} us",
    ),
}  # fmt: skip
