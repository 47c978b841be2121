"""Names of all that a run holds, each once: unit and meaning of series and arrays, blocks of the file; and a frame of them.

Names of a labeller come from the labeller.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

Arrays = Mapping[str, np.ndarray]

BLOCKS = ("spheres", "clumps", "contacts", "plates")
STATIC_TEXT, SUMMARY_TEXT = "static_arrays", "summary"
PROFILE_GROUP = "profiles"
"""Name of the group of profiles, and of the text with their `bins` and `axis`."""

MAPS, SURFACES = "maps", "surfaces"
"""Names of the groups of what measures have left on the plates, and of the rough plates.

`/maps/NAME` holds, frame after frame, the rows of the lower plate and then those of the upper one, (2 n_y, n_x) per frame,
accumulated since the start. Cells lie in coordinates of the plate: those of the upper plate move with it. Their sides are the
domain's size over their number. `/surfaces/lower`, `/surfaces/upper` are written once: heights (n_y, n_x) [m], and the fields of
`Surface` as attributes.
"""
PLATES = ("lower", "upper")

SURFACE_WEAR = "surface_wear"
"""Name of the map of the depth [m] that wear has taken from the surfaces of the plates so far (`plates.wear`)."""

POSITION = "position"
"""Name of the coordinates in arrays that are read; VTK calls them `Points`."""


class Name(NamedTuple):
    """Unit of a series or an array ("1" for pure numbers and codes), and its meaning."""

    unit: str
    meaning: str


SERIES = {
    "time": Name("s", "Time since the start."),
    "scene_time": Name("s", "The same at the speed of the scene; only with `solver.inertial_number`."),
    "distance": Name("m", "Path of the upper plate after settling; with `through` that of the base."),
    "displacement": Name("m", "Displacement of the upper plate along its first direction of motion; NaN without motion."),
    "base_displacement": Name("m", "Displacement of the base, likewise; only with `through`."),
    "gap": Name(
        "m",
        "Distance between the surfaces of the plates: of the common plate, else the mean over the patches (inside a contact).",
    ),
    "upper_force": Name("N", "Force of the debris on this plate (x, y, z), mean over the output interval."),
    "lower_force": Name("N", "The same on the lower plate; with `domain.walls` also on these."),
    "wall_force_near": Name("N", "Force of the debris on the side wall at y = 0 (x, y, z), at the output."),
    "wall_force_far": Name("N", "The same on the other one; both only with `domain.walls`."),
    "friction_coefficient": Name(
        "1",
        "-(upper_force . first direction of motion) / |normal force|; on a path that is not straight, work of the motion / "
        "(|normal force| path). NaN without load. With `plates.contact` the force is upper_force + direct_force.",
    ),
    "drag_work": Name(
        "J",
        "Work of the plate's sideways motion against the force on it since the start, with `through` that of the base; only "
        "with motion.",
    ),
    "loaded": Name("1", "Number of bodies that carry load."),
    "active": Name("1", "Fraction of bodies that are pressed from above and from below."),
    "direct_force": Name("N", "Force of direct contact on the upper plate, as `upper_force`; only with `plates.contact`."),
    "ejected": Name("1", "Number of bodies that are `out` (`out_after`); only with a pressure profile."),
    "inside": Name("1", "Number of bodies in the contact of the first bodies; only with a pressure profile."),
    "load_share_debris": Name("1", "Part of the load that debris carries; NaN without load; only with `plates.contact`."),
    "worn_volume_lower": Name("m3", "Volume taken from the surface of this plate so far; only with `plates.wear`."),
    "worn_volume_upper": Name("m3", "Volume taken from the surface of this plate so far; only with `plates.wear`."),
    "rms_height_lower": Name("m", "Root mean square of the heights of this plate now; only with `plates.wear`."),
    "rms_height_upper": Name("m", "Root mean square of the heights of this plate now; only with `plates.wear`."),
    "rms_slope_lower": Name("1", "Root mean square of the slopes of this plate now; only with `plates.wear`."),
    "rms_slope_upper": Name("1", "Root mean square of the slopes of this plate now; only with `plates.wear`."),
    "contact_half_width": Name(
        "m", "Half width of the contact with an edge; only with it and `plates.wear`, where a ball wears."
    ),
    "accommodation_upper_slip": Name("m/s", "Part of the upper plate's speed taken up by slip at its contacts."),
    "accommodation_lower_slip": Name("m/s", "Part taken up by slip at the lower plate."),
    "accommodation_rolling": Name("m/s", "Part taken up by rotation of the bodies at the plates."),
    "accommodation_shear": Name("m/s", "Part taken up by shear inside the bed."),
    "inertial_number": Name(
        "1",
        "Shear rate * d50 * sqrt(density / pressure), mean over the output interval. Shear rate: of the band that shears, from "
        "the velocities of the bodies; d50: median by mass of the volume-equivalent diameters. NaN in layers thinner than 3 d50. "
        "Beds only: debris that meets debris between two plates, explicit integrator.",
    ),
    "inertial_number_largest": Name("1", "The same with the largest diameter; beds only."),
    "softness": Name("1", "(E* / pressure)^(2/3) of the softest debris: above 1e4 stiff, below 1e3 soft; beds only."),
    "overlap_ratio": Name("1", "Mean overlap of loaded contacts over the smaller radius; beds only."),
    "unbalanced_force": Name("1", "Mean total force on loaded bodies over mean contact force; beds only."),
    "kinetic_energy_ratio": Name(
        "1", "Kinetic energy of the bodies relative to the mean flow over elastic energy of the contacts; beds only."
    ),
    "coordination_number": Name("1", "Mean number of loaded contacts over all bodies, also those without any; beds only."),
    "solid_fraction": Name(
        "1",
        "Volume of the bodies over that of the core of the bed, which excludes one largest diameter (at most a quarter of the "
        "gap) at each plate. NaN in layers thinner than 3 d50; beds only.",
    ),
    "energy_kinetic": Name("J", "Kinetic energy of bodies and free patches; with `through` also of the plate, sideways."),
    "energy_elastic_normal": Name("J", "Energy of the normal springs of contacts."),
    "energy_elastic_tangential": Name("J", "Energy of the tangential and rolling springs of contacts."),
    "energy_foundation": Name("J", "Energy of the springs of a foundation; only with one."),
    "energy_drive_spring": Name("J", "Energy of the springs between base and plate; only with `through`."),
    "energy_direct_elastic": Name("J", "Elastic energy of direct contact; only with `plates.contact`."),
    "energy_direct_friction": Name("J", "Dissipated by friction of direct contact since the start; only with `plates.contact`."),
    "energy_damping": Name("J", "Dissipated by dashpots since the start."),
    "energy_friction": Name("J", "Dissipated by slip since the start."),
    "energy_adhesion": Name("J", "Lost as necks form and break since the start; only with `effects.adhesion` and necks."),
    "energy_plastic": Name("J", "Plastic dissipation since the start; only with a plastic law (`effects.elastic_plastic`)."),
    "energy_wear": Name("J", "Elastic energy of contacts that went with the worn depth; only with `plates.wear`."),
    "energy_plate_work": Name("J", "Work of the plates since the start."),
    "energy_body_effects": Name("J", "Work of body effects since the start; only with such effects."),
    "energy_numerical": Name("J", "Lost by the implicit integrator itself since the start; 0 in explicit runs."),
    "energy_residual": Name("J", "Work minus stored energy minus dissipation: error of the energy balance."),
}
"""One value per frame; labelled runs have the fraction of bodies in each state as well, such as `fraction_rolling`."""

ACCOMMODATION = tuple(name for name in SERIES if name.startswith("accommodation_"))
"""The parts of the plate's speed, which add up to it; only with two plates of which one moves."""
BED = (
    "inertial_number", "inertial_number_largest", "softness", "overlap_ratio", "unbalanced_force", "kinetic_energy_ratio",
    "coordination_number", "solid_fraction",
)  # fmt: skip
"""Series of the measures of a bed."""

FRACTION = Name("1", "Fraction of bodies in this state.")
COUNT = Name("1", "Number of bodies with this reason for their state; only with `output.sample`.")

SPHERES = {
    "position": Name("m", "Centre of the sphere, (S, 3)."),
    "id": Name("1", "Number of the sphere."),
    "clump": Name("1", "Number of its body."),
    "radius": Name("m", "Radius."),
    "velocity": Name("m/s", "Velocity of the centre, (S, 3)."),
    "state": Name("1", "State of its body, a code of `state_names`."),
    "state_reason": Name("1", "Reason for that state, a code of `reason_names`."),
}
CLUMPS = {
    "position": Name("m", "Centre of mass, (B, 3)."),
    "id": Name("1", "Number of the body."),
    "scene_id": Name("1", "Number of the body in the scene; only with `output.sample`."),
    "population": Name("1", "Population, a code of `population_names`."),
    "material": Name("1", "Material, a code of `material_names`."),
    "mass": Name("kg", "Mass."),
    "diameter": Name("m", "Volume-equivalent diameter."),
    "quaternion": Name("1", "Orientation (w, x, y, z), body to world, (B, 4)."),
    "velocity": Name("m/s", "Velocity of the centre of mass, (B, 3)."),
    "angular_velocity": Name("rad/s", "Angular velocity, world axes, (B, 3)."),
    "force": Name("N", "Total force, (B, 3)."),
    "torque": Name("N·m", "Total torque about the centre of mass, (B, 3)."),
    "friction_work": Name("J", "Dissipated by slip at its contacts since the start; two bodies in contact share it equally."),
    "adhesion_work": Name("J", "Lost as necks of its contacts form and break since the start; only with such a law."),
    "agglomerate": Name(
        "1", "Lowest id of the bodies joined by contacts that push with less than their pull-off; only with adhesion."
    ),
    "plastic_work": Name("J", "Plastic dissipation of its contacts since the start, as `friction_work`; only with such a law."),
    "slip_distance": Name("m", "Slip of all its contacts since the start."),
    "exit_position": Name("m", "Where a body that is `out` left, under the upper body from the middle of the contact, (B, 2)."),
    "exit_distance": Name("m", "Path of the upper plate at which it left. Both NaN for others; only with a pressure profile."),
    "utilisation": Name("1", "Largest ratio of tangential force to friction limit at its contacts."),
    "contacts": Name("1", "Number of its contacts."),
    "peak_pressure": Name("Pa", "Largest elastic pressure in its contacts."),
    "state": Name("1", "State, a code of `state_names`."),
    "state_reason": Name("1", "Reason for the state, a code of `reason_names`."),
}
LOWER_PLATE, UPPER_PLATE = -1, -2
"""Values of `partner` of contacts with a plate."""
SIDES = ("lower", "upper", "debris", "wall")
"""What a contact touches, by the codes of `side` (`kernels.tables`)."""

CONTACTS = {
    "position": Name("m", "Contact point, (C, 3)."),
    "body": Name("1", "Body that owns the contact."),
    "partner": Name("1", "The other body; -1 lower plate, -2 upper plate, -3 a body not in the file."),
    "side": Name("1", "Partner: 0 lower plate, 1 upper plate, 2 debris, 3 side wall."),
    "normal": Name("1", "Unit normal from partner to owner, (C, 3)."),
    "normal_force": Name("N", "Normal force, positive in compression."),
    "tangential_force": Name("N", "Tangential force on the owner, (C, 3)."),
    "force": Name("N", "Force on the owner, (C, 3)."),
    "utilisation": Name("1", "Tangential force over friction limit."),
    "slip": Name("m", "Path length of the slip since the contact closed."),
    "overlap": Name("m", "Overlap."),
    "contact_radius": Name("m", "Radius of the contact area."),
    "peak_pressure": Name("Pa", "Largest pressure in the contact area by the normal law, without dashpots."),
    "critical_slip": Name("m", "Displacement at which a virgin contact under this load slips throughout."),
    "moment": Name("N·m", "Rolling moment on the owner, (C, 3); only with rolling resistance."),
    "rolling_utilisation": Name("1", "Rolling moment over its limit; only with rolling resistance."),
    "twist_moment": Name("N·m", "Moment on the owner about the normal; only with pivoting friction."),
    "twist_utilisation": Name("1", "Size of the twist moment over its limit; only with pivoting friction."),
}
CYCLES = {
    "cycle": Name("1", "Number of the cycle, from 1."),
    "start_time": Name("s", "Time at the start of the cycle."),
    "end_time": Name("s", "Time at its end."),
    "energy": Name(
        "J", "Work of the sideways motion against the force on the plate; without `drag_work`, of the mean friction force."
    ),
    "friction_coefficient": Name("1", "Mean of |friction force| / normal force."),
    "friction_coefficient_min": Name("1", "Least friction coefficient, signed by the first direction of motion."),
    "friction_coefficient_max": Name("1", "Largest friction coefficient, signed likewise."),
    "tangential_force_min": Name("N", "Least friction force, signed likewise."),
    "tangential_force_max": Name("N", "Largest friction force, signed likewise."),
    "displacement_min": Name("m", "Least displacement."),
    "displacement_max": Name("m", "Largest displacement."),
}
MAP_STATISTICS = {
    "plate": Name("1", "`lower` or `upper`."),
    "map": Name("1", "Name of the map."),
    "mean": Name("1", "Mean over the cells with a value, in `unit`."),
    "percentile_95": Name("1", "95th percentile of these cells, in `unit`."),
    "largest": Name("1", "Largest value of a cell, in `unit`."),
    "unit": Name("1", "Unit of the map."),
    "area_fraction": Name("1", "Area of these cells over that of the plate."),
    "total": Name("1", "Integral over the plate, in `total_unit`; of `wear_depth` the worn volume."),
    "total_unit": Name("1", "Unit of the total."),
}
TRANSITIONS = {
    "frame": Name("1", "Frame with the new state."),
    "time": Name("s", "Time of the frame."),
    "distance": Name("m", "Sliding distance."),
    "body": Name("1", "Number of the body."),
    "from": Name("1", "Old state, a code of `state_names`."),
    "to": Name("1", "New state, a code of `state_names`."),
    "reason": Name("1", "Reason for the new state, a code of `reason_names`."),
    "position": Name("m", "Centre of mass, (T, 3)."),
}
PROFILES = {
    "position": Name("m", "Middle of the slab, (F, bins)."),
    "solid_fraction": Name("1", "Volume of debris over that of the slab; NaN with the kind `spots`."),
    "velocity": Name("m/s", "Mean velocity of the debris, rotation included, (F, bins, 3)."),
    "angular_velocity": Name("rad/s", "Mean angular velocity of bodies, weighted by volume in the slab, (F, bins, 3)."),
    "coordination_number": Name("1", "Loaded contacts of a body, with plates too: mean weighted by volume in the slab."),
    "contact_stress": Name("Pa", "Stress by contact forces, (F, bins, 3, 3): force a on a face across b; pressure positive."),
    "kinetic_stress": Name("Pa", "Stress by velocity fluctuations of the bodies, (F, bins, 3, 3)."),
}
"""One value per frame and slab, means over the output interval; labelled runs have the fraction of the volume of debris in each
state as well. Only with `output.profiles`."""

TABLES = {
    "series": SERIES, "profiles": PROFILES, "bodies": CLUMPS, "spheres": SPHERES, "contacts": CONTACTS, "cycles": CYCLES,
    "transitions": TRANSITIONS, "map_statistics": MAP_STATISTICS,
}  # fmt: skip
"""All tables by the names that `Run` gives them."""

ARRAY_UNITS = {
    name: entry.unit for arrays in (SPHERES, CLUMPS, CONTACTS) for name, entry in arrays.items() if entry.unit != "1"
} | {"speed": "m/s", "rolled_distance": "m"}  # fmt: skip
"""Units of arrays by name, without those of pure numbers and codes; `speed` is drawn, not stored, and
`rolled_distance` is written by labellers."""


@dataclass(frozen=True)
class Frame:
    """All arrays written at one time, by name, in SI units.

    `points` of spheres (S, 3) and clumps (B, 3) are centres, of contacts (C, 3) the contact points, of plates (8, 3) the corners
    of the lower plate, then of the upper one; other arrays have one row per point. C may change and be 0. The names of the arrays
    are those of the first frame. `series` holds numbers or small vectors, `profiles` arrays with one row per slab, `maps` arrays
    (2, n_y, n_x) of what lies on the cells of the lower and of the upper plate.
    """

    time: float
    spheres: Arrays
    clumps: Arrays
    contacts: Arrays
    plates: Arrays | None = None
    series: Mapping[str, Any] = field(default_factory=dict)
    profiles: Arrays = field(default_factory=dict)
    maps: Arrays = field(default_factory=dict)

    def block(self, name: str) -> Arrays:
        """Return the arrays of one block; without plates the block has no points."""
        arrays = getattr(self, name)
        return {"points": np.empty((0, 3))} if arrays is None else arrays
