"""Data of a close-up of one particle: its contacts, the force on it at each, and the limits of friction.

No drawing here.
"""

from dataclasses import dataclass, replace

import numpy as np

from thirdbody.errors import InputError
from thirdbody.palette import STATE_COLORS, pale
from thirdbody.render.coloring import LegendScale
from thirdbody.render.force_tubes import nearest_image
from thirdbody.render.picture_data import FREE_SCALE, PictureData, domain_of, read_picture_data
from thirdbody.trajectory.reader import Run
from thirdbody.trajectory.rebuilt_spheres import rows_of
from thirdbody.trajectory.sample import ELSEWHERE

UNLABELLED = "#5A626C"


@dataclass(frozen=True)
class Spots:
    """Contacts of one body, (K, ...).

    `position` [m], inward `normal`, `force` on the body [N], the largest friction `limit` [N], utilisation, radius [m], and the
    name of each partner.
    """

    position: np.ndarray
    normal: np.ndarray
    force: np.ndarray
    limit: np.ndarray
    utilisation: np.ndarray
    radius: np.ndarray
    against: list[str]


@dataclass(frozen=True)
class CloseUpData:
    """Data of one particle for drawing: the picture around it, its centre (3,) and size [m], its contacts and texts."""

    picture: PictureData
    center: np.ndarray
    extent: float
    spots: Spots
    name: str
    label: str
    color: str


def read_close_up(run: Run, frame: int, body: int, color: str, scale: LegendScale = FREE_SCALE) -> CloseUpData:
    """Return the close-up of the body with this id. Raises InputError when it, or recorded contacts, are missing."""
    bodies = run.bodies(frame)
    ids = bodies.get("id", np.arange(len(bodies["position"])))
    if body not in ids:
        raise InputError(f"body: this run has no body {body}; ids are {ids.min()} to {ids.max()}")
    picture = read_picture_data(run, frame, color, scale=scale)
    row = int(rows_of(bodies, np.array([body]))[0])
    size, periodic = domain_of(run)
    period = size if periodic else None
    center = picture.bodies[row]
    # Neighbours across the edge of the domain are drawn on the particle's side.
    moved = nearest_image(picture.bodies - center, period) + center
    own = picture.body == row
    # Contacts in the colour of the state must be visible on it; a number keeps its colour.
    own_colors = pale(picture.colors, 0.30) if picture.legend.limits is None else picture.colors
    colors = np.where(own[:, None], own_colors, pale(picture.colors, 0.75))
    picture = replace(picture, centers=picture.centers + (moved - picture.bodies)[picture.body], bodies=moved, colors=colors)
    reach = np.linalg.norm(picture.centers[own] - center, axis=1) + picture.radii[own]
    spots = _spots(run, frame, body, bodies, row, period)
    spots = replace(spots, position=spots.position + center)
    state = run.state_names[bodies["state"][row]] if "state" in bodies else ""
    label = picture.labels[row] if picture.labels else ""
    state_color = STATE_COLORS.get(state, UNLABELLED)
    return CloseUpData(picture, center, 2.0 * float(reach.max()), spots, f"particle {body}", label, state_color)


def _spots(run: Run, frame: int, body: int, bodies: dict[str, np.ndarray], row: int, period: np.ndarray | None) -> Spots:
    """Return the contacts with positions relative to the body's centre."""
    contacts = run.contacts(frame)
    missing = {"body", "partner", "force", "normal", "normal_force", "utilisation", "contact_radius"} - set(contacts)
    if missing:
        raise InputError(f"body: this run recorded no '{sorted(missing)[0]}' of its contacts")
    first, second = contacts["body"] == body, contacts["partner"] == body
    chosen = np.flatnonzero((first | second) & (contacts["normal_force"] > 0.0))
    chosen = chosen[np.argsort(-contacts["normal_force"][chosen], kind="stable")]
    sign = np.where(first[chosen], 1.0, -1.0)[:, None]
    partner = np.where(first[chosen], contacts["partner"][chosen], contacts["body"][chosen])
    names = {-1: "lower plate", -2: "upper plate", ELSEWHERE: "particle not in the file"}
    load, eta = contacts["normal_force"][chosen], contacts["utilisation"][chosen]
    force, normal = contacts["force"][chosen], contacts["normal"][chosen]
    tangential = np.linalg.norm(force - load[:, None] * normal, axis=1)
    # Without tangential force the limit does not follow from the utilisation: the ratio of the other contacts is used.
    known = eta > 1e-6
    ratio = np.divide(tangential, eta * load, out=np.zeros_like(load), where=known)
    ratio[~known] = ratio.max(initial=0.0)
    return Spots(
        position=nearest_image(contacts["position"][chosen] - bodies["position"][row], period),
        normal=sign * normal,
        force=sign * force,
        limit=ratio * load,
        utilisation=eta,
        radius=contacts["contact_radius"][chosen],
        against=[names.get(int(number), f"particle {number}") for number in partner],
    )
