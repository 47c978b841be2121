"""Debris of the kind `spheroid`: ellipsoids of revolution as spheres on their medial axis.

Semi-axes 1 and r < 1 (in units of the longer one), E^2 = 1 - r^2. The medial axis is a segment (prolate) or a disc (oblate) of
radius E^2; the sphere centred there at the distance x = E^2 u from the middle has the radius r sqrt(1 - E^2 u^2) and touches the
spheroid from inside, at the tips or the rim (u = 1) with the spheroid's own radius of curvature r^2. A displacement s along the
medial axis from the nearest centre leaves a gap s^2/(2 E^2 rho) between the union of spheres and the spheroid (rho: radius of the
sphere), the same in both directions of the disc. Steps in proportion to sqrt(rho) therefore leave equal gaps: on the segment h =
E^2 I^2/(8 r (n - 1)^2), I = integral from -1 to 1 of (1 - E^2 u^2)^(-1/4) du.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from thirdbody.debris.contract import MAX_SPHERES_PER_BODY, PlacedDebris, RandomStreams
from thirdbody.schema.fields import Quantity, Whole
from thirdbody.schema.parts import Wrong
from thirdbody.schema.sizes import Size

if TYPE_CHECKING:
    import numpy as np

    from thirdbody.bodies.clump import Clump

BALL = 1.0 - 1e-6
"""Axial ratio above which a spheroid is one sphere: several would coincide."""

RINGS = range(1, 6)
"""Rings of an oblate body around its middle sphere; ring k has 6 k spheres: 7, 19, 37, 61 or 91 in all."""


class Layout(NamedTuple):
    """Spheres of a spheroid whose longer semi-axis is 1: centers (n, 3), radii (n,); and the volume-equivalent radius."""

    centers: np.ndarray
    radii: np.ndarray
    equivalent_radius: float


def spheres_in_rings(rings: int) -> int:
    """Return the number of spheres in the middle and in rings of 6, 12, 18 ... around it."""
    return 1 + 3 * rings * (rings + 1)


@lru_cache(maxsize=16)
def layout(form: str, axial_ratio: float, spheres: int) -> Layout:
    """Place the spheres on the medial axis: along x (prolate), or in the plane z = 0 (oblate)."""
    import numpy as np

    volume = axial_ratio**2 if form == "prolate" else axial_ratio
    if spheres == 1:
        return Layout(np.zeros((1, 3)), np.ones(1), 1.0)
    squared = 1.0 - axial_ratio**2
    if form == "prolate":
        steps = (2.0 * np.arange(spheres) - (spheres - 1)) / (spheres - 1)
        u, v = np.copysign(_graded(np.abs(steps), squared), steps), np.zeros(spheres)
    else:
        rings = next(k for k in RINGS if spheres_in_rings(k) == spheres)
        ring = np.repeat(np.arange(rings + 1), [1, *(6 * k for k in range(1, rings + 1))])
        rotation = np.concatenate([[0.0], *(np.arange(6 * k) * (math.pi / (3 * k)) for k in range(1, rings + 1))])
        distance = _graded(ring / rings, squared)
        u, v = distance * np.cos(rotation), distance * np.sin(rotation)
    radii = axial_ratio * np.sqrt(1.0 - squared * (u**2 + v**2))
    return Layout(squared * np.column_stack((u, v, np.zeros(spheres))), radii, volume ** (1.0 / 3.0))


def _graded(steps: np.ndarray, squared: float) -> np.ndarray:
    """Return positions u in [0, 1] for even steps in [0, 1]: closer together where the spheres are smaller, for equal gaps."""
    import numpy as np

    u = np.linspace(0.0, 1.0, 4097)
    weight = (1.0 - squared * u**2) ** -0.25
    distance = np.concatenate(([0.0], np.cumsum(0.5 * (weight[1:] + weight[:-1]))))
    return np.interp(steps, distance / distance[-1], u)


def corrugation(form: str, axial_ratio: float, spheres: int) -> tuple[float, float]:
    """Return the largest gap between spheroid and spheres over the equivalent radius, and angle between their normals [rad].

    Measured at points of a meridian (prolate) or of a twelfth of the surface (oblate), to some 1e-3 of their values.
    """
    import numpy as np

    built = layout(form, axial_ratio, spheres)
    if spheres == 1:
        return 0.0, 0.0
    if form == "prolate":
        t = np.linspace(0.0, math.pi, 64 * spheres + 1)
        points = np.column_stack((np.cos(t), axial_ratio * np.sin(t), np.zeros_like(t)))
    else:
        grid = np.meshgrid(np.linspace(0.0, 0.5 * math.pi, 241), np.linspace(0.0, math.pi / 6.0, 61))
        t, rotation = (angle.ravel() for angle in grid)
        points = np.column_stack((np.cos(t) * np.cos(rotation), np.cos(t) * np.sin(rotation), axial_ratio * np.sin(t)))
    normals = points / np.array([1.0, axial_ratio, axial_ratio] if form == "prolate" else [1.0, 1.0, axial_ratio]) ** 2
    gap, cosine = np.full(len(points), np.inf), np.empty(len(points))
    for center, radius in zip(built.centers, built.radii, strict=True):
        away = points - center
        distance = np.linalg.norm(away, axis=1)
        nearer = distance - radius < gap
        cosine[nearer] = np.einsum("ij,ij->i", away, normals)[nearer] / distance[nearer]
        gap = np.minimum(gap, distance - radius)
    cosine /= np.linalg.norm(normals, axis=1)
    return float(gap.max()) / built.equivalent_radius, float(np.arccos(np.minimum(cosine, 1.0)).max())


def in_one_piece(form: str, axial_ratio: float, spheres: int) -> bool:
    """Return whether overlaps connect all spheres."""
    import numpy as np
    from scipy.sparse.csgraph import connected_components

    centers, radii, _ = layout(form, axial_ratio, spheres)
    near = np.linalg.norm(centers[:, None] - centers, axis=-1) < radii[:, None] + radii
    return connected_components(near, directed=False, return_labels=False) == 1


class Spheroid(PlacedDebris):
    """Ellipsoids of revolution: spheres on the medial axis, each inside the spheroid and touching it.

    `size` is the diameter of the ball of the spheroid's volume (m), `axial_ratio` the shorter over the longer axis, `form`
    "prolate" (spheres on a segment) or "oblate" (on a disc: the largest of 7, 19, 37, 61, 91 that is allowed), `spheres` the
    most per body. The more spheres, the closer their union comes to the spheroid, from inside. Where the overlap of a contact
    exceeds the corrugation, which `check` tells, several spheres share the contact and stiffen it: then take fewer. A prolate
    body of an even number lies on two spheres. One whose long axis does not lie along the drag rolls about that axis, whatever
    its friction: `heading` lays all bodies of a layer in one direction.
    """

    kind: Literal["spheroid"] = "spheroid"
    size: Size
    """Volume-equivalent diameter. Example: {distribution = "lognormal", median = "10 um", sigma = 0.2}."""
    axial_ratio: Annotated[float, Quantity(ge=0.1, le=1)]
    """Shorter over longer axis. Example: 0.5."""
    form: Literal["prolate", "oblate"] = "prolate"
    """"prolate": long, spheres on a segment; "oblate": flat, spheres on a disc. Example: "oblate"."""
    spheres: Annotated[int, Whole(ge=2, le=MAX_SPHERES_PER_BODY)] = 20
    """Most spheres of a body; an oblate one has the largest number of 7, 19, 37, 61, 91 up to this. Example: 20."""

    heading: Annotated[float, Quantity(dimension="angle")] | None = None
    """Direction of the long axis of prolate bodies in a layer, from x towards y; by default random. Example: "0 deg"."""

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        faults = super().rules(raw, context)
        if "heading" in raw and raw.get("placement", "layer") != "layer":
            faults.append((("heading",), "needs placement = 'layer'"))
        elif "heading" in raw and raw.get("form", "prolate") != "prolate":
            faults.append((("heading",), "needs form = 'prolate': an oblate body has no long axis"))
        return faults

    def checks(self) -> list[Wrong]:
        if self.axial_ratio > BALL:
            return []
        if self.form == "oblate" and self.spheres < spheres_in_rings(RINGS[0]):
            return [(("spheres",), f"{self.spheres} must be at least {spheres_in_rings(RINGS[0])} in an oblate body")]
        if in_one_piece(self.form, self.axial_ratio, self.max_spheres()):
            return []
        tried = map(spheres_in_rings, RINGS) if self.form == "oblate" else range(2, MAX_SPHERES_PER_BODY + 1)
        enough = next((n for n in tried if n > self.spheres and in_one_piece(self.form, self.axial_ratio, n)), None)
        body = f"{'an' if self.form == 'oblate' else 'a'} {self.form} spheroid of axial_ratio {self.axial_ratio:g}"
        apart = f"{self.max_spheres()} spheres of {body} do not hang together"
        if enough is None:
            return [(("axial_ratio",), f"{apart}, and no more are possible: raise axial_ratio")]
        return [(("spheres",), f"{apart}: at least {enough}")]

    def max_spheres(self) -> int:
        if self.axial_ratio > BALL:
            return 1
        if self.form == "prolate":
            return self.spheres
        return max((n for n in map(spheres_in_rings, RINGS) if n <= self.spheres), default=self.spheres)

    def clumps(self, random: RandomStreams) -> list[Clump]:
        from thirdbody.bodies.clump import clump

        built = layout(self.form, self.axial_ratio, self.max_spheres())
        shape = clump(built.centers, built.radii)
        sizes = random.diameters(self.size, self.count)
        return [shape.scaled(0.5 * size / built.equivalent_radius) for size in sizes]

    def notes(self) -> list[str]:
        n = self.max_spheres()
        if n == 1:
            return []
        height, angle = corrugation(self.form, self.axial_ratio, n)
        near = f"{100.0 * height:.2g} % of its equivalent radius and {math.degrees(angle):.2g} deg of its normals"
        return [f"{n} spheres follow the spheroid to {near} at most (corrugation)"]


KIND = Spheroid
