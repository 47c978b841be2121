"""How far the spots of all bodies lower a plate under each other, against overlaps: what relief between bodies would change.

`PYTHONPATH=tests python tests/bench/plate_relief.py [SCENE]`: the scene (`sheared_debris`) after 1 um of drag, lower plate.
Relief of a spot by Boussinesq's solution, c N/r, of the other spots of its body and of those of all other bodies within half the
domain around it (periodic). A uniform relief only lowers a plate, so its mean is told apart.
"""

import sys

import numpy as np
from stories import SCENE

import thirdbody
from thirdbody.kernels.columns import record
from thirdbody.kernels.columns.sides import LOWER
from thirdbody.runner.prepare import prepare

DRAG = 1e-6


def main() -> None:
    """Print reliefs over the mean overlap."""
    scene = thirdbody.Scene.load(sys.argv[1] if len(sys.argv) > 1 else SCENE)
    run = prepare(scene)
    run.integrator.advance_to(time=run.settle)
    run.integrator.advance_to(distance=DRAG)
    state, slots = run.state, run.state.slots
    rows = (slots.histories.slip > 0.0) & (slots.sides == LOWER)
    force, overlap = slots.R[rows, record.NORMAL_FORCE], slots.R[rows, record.OVERLAP]
    owner = state.body[slots.own[rows]]
    place = (slots.R[rows, record.POINT3] + state.bodies.position[owner])[:, :2]
    assert scene.plates.lower is not None
    plate = scene.materials[scene.plates.lower.material]
    c = (1.0 - plate.poisson_ratio) / (2.0 * np.pi * plate.shear())
    size = np.array(scene.domain.size)
    apart = place[:, None] - place[None]
    distance = np.linalg.norm(apart - size * np.rint(apart / size), axis=2)
    np.fill_diagonal(distance, np.inf)
    same = owner[:, None] == owner[None]
    near = distance < 0.5 * size.min()
    own = np.where(same, c / distance, 0.0) @ force
    others = np.where(near & ~same, c / distance, 0.0) @ force
    left = others - others.mean()
    # what turns a body: the part that is not equal at its spots
    mean = np.bincount(owner, others) / np.maximum(np.bincount(owner), 1)
    unequal = (others - mean[owner])[np.bincount(owner)[owner] > 1]
    print(f"{len(force)} spots of {len(np.unique(owner))} bodies, mean overlap {overlap.mean():.3g} m; over that:")
    print(f"relief by the body's own spots, mean {own.mean() / overlap.mean():.2%}")
    print(f"relief by all others, mean {others.mean() / overlap.mean():.1%}, scatter {left.std() / overlap.mean():.2%}")
    print(f"its differences between the spots of a body, root mean square {np.sqrt((unequal**2).mean()) / overlap.mean():.2%}")


if __name__ == "__main__":
    main()
