"""Runs of the robustness cases, and search for the largest stable time step of each."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from thirdbody.errors import ThirdbodyError, UsageError, nearest
from thirdbody.studies.robustness.case import Setting, Trial
from thirdbody.studies.robustness.cases import CASES, Case

FACTORS = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0)
"""Trial time steps, over the smallest automatic one of the run."""

MIN_FACTOR, MAX_FACTOR = 1.2, 10.0
"""Required range of the largest stable factor: the automatic step has a margin, but not more than that."""

QUICK = "mindlin"
"""Level of the short version."""


@dataclass(frozen=True)
class Row:
    """Result of one case with one integrator at one level.

    `factor`: largest stable step over the automatic one, None where it was not sought; `beyond`: the failure at the next one;
    `broken`: the invariants that did not hold with the automatic step.
    """

    case: str
    what: str
    integrator: str
    level: str
    residual: float
    seconds: float
    broken: tuple[str, ...] = ()
    factor: float | None = None
    beyond: str = ""

    @property
    def passed(self) -> bool:
        """Whether every invariant held, and the largest stable step, if sought, lies in the required range."""
        return not self.broken and (self.factor is None or MIN_FACTOR <= self.factor <= MAX_FACTOR)


def chosen(names: Sequence[str]) -> tuple[Case, ...]:
    """Return the cases of these names, all if none is given. Raises UsageError."""
    known = {case.name: case for case in CASES}
    for name in names:
        if name not in known:
            raise UsageError(f"{name}: no such case, {nearest(name, known)}")
    return tuple(known[name] for name in names) if names else CASES


def settings_of(case: Case, quick: bool = False) -> list[Setting]:
    """Return all settings of a case; the short version at one level only."""
    levels = case.levels if not quick or QUICK not in case.levels else (QUICK,)
    return [Setting(kind, level, full=not quick) for kind in case.integrators for level in levels]


def rows(
    cases: Sequence[Case], quick: bool = False, sweep: bool = True, log: Callable[[str], None] = lambda _: None
) -> Iterator[Row]:
    """Run cases in sequence; `log` is called with a line before each."""
    for case in cases:
        for setting in settings_of(case, quick):
            log(f"{case.name}, {setting.integrator}, {setting.level}")
            yield run_case(case, setting, sweep)


def run_case(case: Case, setting: Setting, sweep: bool = True) -> Row:
    """Run a case with the automatic step, then, if it holds and has a limit, with growing ones."""
    begun = time.perf_counter()
    trial, broken = attempt(case, setting)
    factor, beyond = None, ""
    if sweep and case.swept and not broken and setting.integrator == "explicit":
        factor, beyond = largest_step(case, setting, trial.steps)
    seconds = time.perf_counter() - begun
    return Row(case.name, case.what, setting.integrator, setting.level, trial.residual, seconds, broken, factor, beyond)


def attempt(case: Case, setting: Setting) -> tuple[Trial, tuple[str, ...]]:
    """Run a case; return its trial and its failures: broken invariants, the worst of each name, and the stop message."""
    trial = Trial(setting)
    stop: tuple[str, ...] = ()
    try:
        case.action(trial)
    except ThirdbodyError as error:
        stop = (str(error),)
    worst = {finding.name: finding for finding in sorted(trial.broken(), key=lambda finding: finding.value)}
    return trial, tuple(str(finding) for finding in worst.values()) + stop


def largest_step(case: Case, setting: Setting, steps: Sequence[float]) -> tuple[float, str]:
    """Return the largest of FACTORS at which everything holds, 0 if not even the first, and the failure at the next one."""
    largest = 0.0
    for factor in FACTORS:
        fixed = Setting(setting.integrator, setting.level, tuple(steps), factor, setting.full)
        _, broken = attempt(case, fixed)
        if broken:
            return largest, f"at {factor:g}: {broken[-1]}"
        largest = factor
    return largest, ""
