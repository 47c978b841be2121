"""The debris of the main scene by both integrators: what a run tells at equal distances, and how far two runs agree."""

import time
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
import thirdbody
from thirdbody.bodies.packing import projected_area
from thirdbody.kernels.tables import DEBRIS, run_totals
from thirdbody.runner.simulate import prepare
from thirdbody.studies.cost import displacements, rms_error
from thirdbody.studies.timing import nudge as displace

SCENE = Path(__file__).parent.parent / "scenes" / "sheared_debris.toml"

PATH, STOPS = 20e-6, 20  # drag, m, and the number of stops on it


@dataclass
class Story:
    """What a run tells at equal distances: labels (F, n), friction (F), centres (F, n, 3), and which bodies have touched others.
    `seconds` of sliding, `size` of the domain, m."""

    labels: np.ndarray
    friction: np.ndarray
    centres: np.ndarray
    met: np.ndarray
    seconds: float
    size: np.ndarray


@dataclass(frozen=True)
class Agreement:
    """Share of equal labels at the end, and at all stops; differences of the mean friction over its value, of the mean place
    over the drag; share of bodies whose places differ by less than 1 % of the drag."""

    labels: float
    all_labels: float
    friction: float
    place: float
    alike: float

    def __str__(self) -> str:
        labels, every, friction, place, alike = (100.0 * part for part in astuple(self))
        return (
            f"labels {labels:.2f} % ({every:.2f} % at all stops), friction {friction:.3f} %, "
            f"mean place {place:.3f} % of the drag, {alike:.1f} % of the bodies within 1 % of it"
        )


def dragged(scene: thirdbody.Scene, nudge: float = 0.0, path: float = PATH) -> Story:
    """Return the story of a scene that is dragged by `path`, its bodies displaced and turned at the start by `nudge`."""
    built = prepare(scene)
    state = built.state
    if nudge:
        displace(state, 1, nudge)
    built.integrator.advance_to(time=built.settle)
    started, labels, friction, centres = time.perf_counter(), [], [], []
    met = np.zeros(state.n_bodies, bool)
    for stop in np.arange(1, STOPS + 1) * path / STOPS:
        before = state.A.copy()
        built.integrator.advance_to(distance=float(stop))
        push = (state.A - before)[run_totals.UPPER_IMPULSE3]
        labels.append(built.integrator.label()[:, 0])
        friction.append(-push[0] / abs(push[2]))
        centres.append(state.bodies.position.copy())
        pairs = (state.slots.histories.slip > 0.0) & (state.slots.sides == DEBRIS)
        met[state.body[state.slots.own[pairs]]] = met[state.body[state.slots.partner[pairs]]] = True
    seconds = time.perf_counter() - started
    return Story(np.array(labels), np.array(friction), np.array(centres), met, seconds, np.array(scene.domain.size))


def agreement(a: Story, b: Story, path: float = PATH) -> Agreement:
    equal = a.labels == b.labels
    apart = displacements(b.centres[-1], a.centres[-1], a.size)
    place, alike = np.linalg.norm(apart.mean(axis=0)) / path, np.mean(np.linalg.norm(apart, axis=1) < 0.01 * path)
    friction = rms_error(b.friction, a.friction, of_means=True)
    return Agreement(float(np.mean(equal[-1])), float(np.mean(equal)), friction, float(place), float(alike))


def layer(fraction: float, bodies: int, **settings: object) -> thirdbody.Scene:
    """Return the main scene with fewer bodies that cover this fraction of the lower plate, seen from above."""
    base = thirdbody.Scene.load(SCENE)
    size = np.array(base.domain.size)
    wide = base.with_settings({"debris.0.count": bodies, "domain.size": [f"{x:.9g} m" for x in size * (bodies / 500.0) ** 0.5]})
    state = prepare(wide).state
    covered = sum(projected_area(state.S[state.body == number, :4]) for number in range(state.n_bodies))
    stretch = (covered / (fraction * size.prod())) ** 0.5
    return wide.with_settings({"domain.size": [f"{x:.9g} m" for x in size * stretch]} | settings)
