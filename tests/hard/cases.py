"""The hard cases by name, their runs, and the search for the largest stable time step of each."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from hard import between_plates as plates
from hard import effects
from hard import free_bodies as free
from hard import meeting_bodies as meeting
from hard import rough_plates as rough
from hard.trial import Setting, Trial
from thirdbody.errors import ThirdbodyError

FACTORS = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0)  # trial time steps, over the smallest automatic one of the run
MIN_FACTOR, MAX_FACTOR = 1.2, 10.0
"""Required range of the largest stable factor: the automatic step has a margin, but not more than that."""
LEVELS = ("coulomb", "mindlin", "mdr", "exact")  # levels of the law family three_spot, from coarse to fine
BOTH, EXPLICIT, TWO, COULOMB = ("explicit", "implicit"), ("explicit",), LEVELS[:2], LEVELS[:1]


@dataclass(frozen=True)
class Case:
    """`swept`: it has a largest stable time step; others have no oscillation, or test something else."""

    action: Callable[[Trial], None]
    integrators: tuple[str, ...] = BOTH
    levels: tuple[str, ...] = LEVELS
    swept: bool = True

    @property
    def name(self) -> str:
        return self.action.__name__

    def settings(self, quick: bool) -> list[Setting]:
        levels = ("mindlin",) if quick and "mindlin" in self.levels else self.levels
        return [Setting(kind, level, full=not quick) for kind in self.integrators for level in levels]


# actions with the same settings, in the order of the table
_GROUPS = (
    ((plates.lost_contact, plates.touch_and_go, plates.no_friction, plates.endless_friction),),
    ((plates.symmetric_spots, plates.degenerate_spots, plates.at_the_limit, plates.both_sides),),
    ((free.oblique_impact, free.mass_ratio, free.rigid_plane), EXPLICIT), ((free.spinning_flake,), EXPLICIT, COULOMB, False),
    ((free.many_steps, free.overlapping_start), BOTH, COULOMB, False), ((free.relaxed_start,), EXPLICIT, LEVELS, False),
    ((free.incompressible,), EXPLICIT), ((plates.stiff_ratio,),), ((free.periodic_face,), EXPLICIT), ((plates.across_a_face,),),
    ((free.hundredfold_step,), EXPLICIT, ("mindlin",), False), ((plates.constant_gap, plates.many_dashpots),),
    ((meeting.two_meet_head_on, meeting.rides_onto, meeting.chain_of_ten, meeting.meets_again), BOTH, LEVELS, False),
    ((meeting.coincident_centres,), BOTH, COULOMB, False),
    ((meeting.one_plate_for_all, meeting.light_on_heavy, rough.wavy_plate, rough.narrow_groove), BOTH, LEVELS, False),
    ((rough.step_of_a_file,), BOTH, TWO, False), ((rough.sharp_valleys,), BOTH, LEVELS, False),
    ((effects.fast_impact,), EXPLICIT, TWO, False),
    ((effects.pressed_again, effects.yields_and_rolls, effects.bounces_until_it_sticks), BOTH, TWO, False),
    ((effects.both_plates_pull, effects.tiny_lump_rolls, effects.pinched_spin, effects.crowded_spots), BOTH, TWO, False),
    ((free.turning_pair,), EXPLICIT, LEVELS, False),
)  # fmt: skip
CASES = {action.__name__: Case(action, *settings) for actions, *settings in _GROUPS for action in actions}


@dataclass(frozen=True)
class Row:
    """Result of a case with one integrator at one level: the invariants `broken` with the automatic step, `factor` of the largest
    stable step over it, None where it was not sought, and the failure `beyond` that."""

    case: str
    integrator: str
    level: str
    residual: float
    seconds: float
    broken: tuple[str, ...] = ()
    factor: float | None = None
    beyond: str = ""

    @property
    def faults(self) -> tuple[str, ...]:
        if self.broken or self.factor is None or MIN_FACTOR <= self.factor <= MAX_FACTOR:
            return self.broken
        wanted = f"not {MIN_FACTOR:g} to {MAX_FACTOR:g}"
        return (f"the largest stable step is {self.factor:g} times the automatic one, {wanted}; {self.beyond}",)


def run_case(case: Case, setting: Setting, sweep: bool = True) -> Row:
    """Run a case with the automatic step, then, if it holds and has a limit, with growing ones."""
    begun = time.perf_counter()
    trial, broken = attempt(case, setting)
    factor, beyond = None, ""
    if sweep and case.swept and not broken and setting.integrator == "explicit":
        factor, beyond = largest_step(case, setting, tuple(trial.steps))
    return Row(case.name, setting.integrator, setting.level, trial.residual, time.perf_counter() - begun, broken, factor, beyond)


def attempt(case: Case, setting: Setting) -> tuple[Trial, tuple[str, ...]]:
    trial, stop = Trial(setting), ()
    try:
        case.action(trial)
    except ThirdbodyError as error:
        stop = (str(error),)
    return trial, trial.broken() + stop


def largest_step(case: Case, setting: Setting, steps: tuple[float, ...]) -> tuple[float, str]:
    """Return the largest of FACTORS at which everything holds, 0 if not even the first, and the failure at the next one."""
    largest = 0.0
    for factor in FACTORS:
        _, broken = attempt(case, Setting(setting.integrator, setting.level, steps, factor, setting.full))
        if broken:
            return largest, f"at {factor:g}: {broken[-1]}"
        largest = factor
    return largest, ""
