"""Robustness cases by name: the failure of a naive code, the test that shows it, and its settings."""

from collections.abc import Callable
from dataclasses import dataclass

from thirdbody.studies.robustness import between_plates as plates
from thirdbody.studies.robustness import free_bodies as free
from thirdbody.studies.robustness import meeting_bodies as meeting
from thirdbody.studies.robustness import necks
from thirdbody.studies.robustness import plastic_flow as plastic
from thirdbody.studies.robustness import rough_plates as rough
from thirdbody.studies.robustness import spot_effects as spots
from thirdbody.studies.robustness.case import Trial

LEVELS = ("coulomb", "mindlin", "mdr", "exact")
"""Levels of the law family three_spot, from coarse to fine."""

BOTH, EXPLICIT = ("explicit", "implicit"), ("explicit",)


@dataclass(frozen=True)
class Case:
    """Robustness case. `swept`: it has a largest stable time step; others have no oscillation, or test something else."""

    name: str
    what: str
    action: Callable[[Trial], None]
    integrators: tuple[str, ...] = BOTH
    levels: tuple[str, ...] = LEVELS
    swept: bool = True


CASES = (
    Case("lost_contact", "d -> 0, spots open under load lost and touch again", plates.lost_contact),
    Case("touch_and_go", "spots leave and touch inside a step", plates.touch_and_go),
    Case("no_friction", "mu = 0: division by kappa", plates.no_friction),
    Case("endless_friction", "mu = 1e9: lost digits", plates.endless_friction),
    Case("symmetric_spots", "x_1 = 0: 0/0", plates.symmetric_spots),
    Case("degenerate_spots", "two, coincident, collinear spots: singular", plates.degenerate_spots),
    Case("at_the_limit", "mu exactly at t_max: neutral equilibrium", plates.at_the_limit),
    Case("both_sides", "both sides slide with equal mu: neutral", plates.both_sides),
    Case("oblique_impact", "undamped impact: energy gain of the law", free.oblique_impact, EXPLICIT),
    Case("mass_ratio", "size ratio 10, mass ratio 1e6", free.mass_ratio, EXPLICIT),
    Case("rigid_plane", "rigid plane: stiffness ratio 1e6", free.rigid_plane, EXPLICIT),
    Case("spinning_flake", "I_3 >> I_1: explicit rotation unstable", free.spinning_flake, EXPLICIT, ("coulomb",), False),
    Case("many_steps", "1e6 steps: quaternion drift", free.many_steps, BOTH, ("coulomb",), False),
    Case("overlapping_start", "stored Hertz energy explodes", free.overlapping_start, BOTH, ("coulomb",), False),
    Case("relaxed_start", "overlaps of 0.3 radii, relaxed: explosion", free.relaxed_start, EXPLICIT, LEVELS, False),
    Case("incompressible", "nu -> .5: limit of the moduli", free.incompressible, EXPLICIT),
    Case("stiff_ratio", "soft on stiff, 1e3, nu = .5", plates.stiff_ratio),
    Case("periodic_face", "pair across a periodic face: lost image", free.periodic_face, EXPLICIT),
    Case("across_a_face", "dragged across a periodic face", plates.across_a_face),
    Case("hundredfold_step", "time step 100 times too long: blow-up", free.hundredfold_step, EXPLICIT, ("mindlin",), False),
    Case("constant_gap", "constant gap, mu > t_max: N unbounded", plates.constant_gap),
    Case("many_dashpots", "dashpots of many spots add up: blow-up", plates.many_dashpots),
    Case("two_meet_head_on", "two bodies block each other: coupled slip", meeting.two_meet_head_on, BOTH, swept=False),
    Case("rides_onto", "a body mounts another: contact handed over", meeting.rides_onto, BOTH, swept=False),
    Case("chain_of_ten", "ten bodies pushed against one: long chain", meeting.chain_of_ten, BOTH, swept=False),
    Case("meets_again", "bodies part and meet at once: stale history", meeting.meets_again, BOTH, swept=False),
    Case("coincident_centres", "one centre: no normal", meeting.coincident_centres, BOTH, ("coulomb",), False),
    Case("one_plate_for_all", "bodies that meet share the load of one plate", meeting.under_one_plate, BOTH, swept=False),
    Case("light_on_heavy", "mass ratio 1e6 between plates", meeting.light_against_heavy, BOTH, swept=False),
    Case("wavy_plate", "rolls from crest to valley: energy of the curvature", rough.wavy_plate, BOTH, swept=False),
    Case("narrow_groove", "a groove narrower than a sphere: two contacts", rough.narrow_groove, BOTH, swept=False),
    Case("step_of_a_file", "a step in a measured surface: no normal", rough.step_of_a_file, BOTH, LEVELS[:2], False),
    Case("sharp_valleys", "valleys sharper than a sphere: contacts come and go", rough.sharp_valleys, BOTH, swept=False),
    Case("fast_impact", "100 V_y: stiffer on the way out than in", plastic.fast_impact, EXPLICIT, LEVELS[:2], False),
    Case("pressed_again", "flows below the old load: lost memory", plastic.pressed_again, BOTH, LEVELS[:2], False),
    Case("yields_and_rolls", "spots flow, part and touch: energy", plastic.yields_and_rolls, BOTH, LEVELS[:2], False),
    Case(
        "bounces_until_it_sticks",
        "pulled off again and again: energy of jumps",
        necks.bounces_until_it_sticks,
        BOTH,
        LEVELS[:2],
        False,
    ),
    Case("both_plates_pull", "both plates pull a ball of 0.2 um apart", necks.both_plates_pull, BOTH, LEVELS[:2], False),
    Case("tiny_lump_rolls", "necks come and go under a rolling lump: memory", necks.tiny_lump_rolls, BOTH, LEVELS[:2], False),
    Case("pinched_spin", "spin about the normal: nothing brakes it", spots.pinched_spin, BOTH, LEVELS[:2], False),
    Case("crowded_spots", "spots relieved wholly by others come and go", spots.crowded_spots, BOTH, LEVELS[:2], False),
    Case("turning_pair", "rigid rotation: history must turn along", free.rotating_pair, EXPLICIT, LEVELS, False),
)
"""In the order of `thirdbody hard`."""
