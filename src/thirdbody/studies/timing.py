"""Time of the integration of a run alone, statistics of a few timings, displaced starts, and the machine of a measurement."""

from __future__ import annotations

import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thirdbody.kernels.tables import body
from thirdbody.system.processes import cores

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.engine.state import State

EMPTY = 50  # number of timed calls that do nothing, for the cost of a call

LONE, KNOWN_LONE, FLOOR, FEW, MANY = 0.5, 0.1, 0.03, 5, 20
"""Relative uncertainties of timings.

A single one: a run varies by LONE on a busy machine, and by at least KNOWN_LONE where others were timed beside it (`lone`).
Of fewer than FEW timings it is half the range, since quartiles mean nothing, and at least that of a single one over their number,
as their agreement may be chance. It is at least FLOOR: the layout of memory alone changes times by some per cent.
"""

NUDGE = 1e-9  # standard deviation of the displacements of a start, in parts of a body's size, and of the rotations [rad]
# Widths of vector registers [bits] by how they are named in assembly, the widest first.
REGISTERS = {"%zmm": 512, "%ymm": 256, "%xmm": 128, ".4s": 128}
# A vector sum as LLVM source: its assembly contains the widest registers of a kind of core.
SUM = "define <16 x float> @add(<16 x float> %a, <16 x float> %b) { %c = fadd <16 x float> %a, %b\n ret <16 x float> %c }"
CACHES = Path("/sys/devices/system/cpu/cpu0/cache")  # folder in which Linux describes the caches of a core


class Late(Exception):
    """The time limit of one run is exceeded."""


def attach(integrator: Any) -> Callable[[], float]:
    """Return a function for the processor seconds in which the integrator advances, without those in which a run is observed."""
    spent, advance = 0.0, integrator.advance_to

    def uncounted(act: Callable[[], None]) -> None:
        nonlocal spent
        spent += time.process_time()
        try:
            act()
        finally:
            spent -= time.process_time()

    def timed(
        until: float = math.inf,
        distance: float = math.inf,
        watch: Callable[[], None] = lambda: None,
        between: Callable[[], None] = lambda: None,
    ) -> None:
        nonlocal spent
        spent -= time.process_time()
        try:
            advance(until, distance, lambda: uncounted(watch), lambda: uncounted(between))
        finally:
            spent += time.process_time()

    integrator.advance_to = timed
    return lambda: spent


def bare(built: Simulation, limit: float) -> tuple[float, float]:
    """Return the seconds (wall, processor) of integrating a built simulation to its end.

    The same stops and steps as in its run, without frames, labels, energies, guards of the run and checkpoints. Body by body,
    each output enters compiled code once for 512 bodies, which takes 0.1 ms for any variant: this is subtracted too, by calls
    that do nothing. Raises GuardStop as the run does, and Late after `limit` seconds of the processor.
    """
    from thirdbody.runner.stops import Settling, targets

    integrator: Any = built.integrator
    calls, end, advance = 0, time.process_time() + limit, getattr(integrator, "advance_islands", None)

    def counted(*arguments: Any) -> None:
        nonlocal calls
        calls += 1
        advance(*arguments)  # type: ignore[misc]

    def watch() -> None:
        if time.process_time() > end:
            raise Late

    if advance is not None:
        integrator.advance_islands = counted
    began, settling = _now(), Settling(built, lambda: None)
    for target in targets(built):
        settling.advance(target, lambda until, distance: integrator.advance_to(until, distance, watch))
    spent = _now() - began
    if calls:
        each = []
        for _ in range(EMPTY):
            began = _now()
            advance(0, 1, built.state.time)  # type: ignore[misc]  # body 0 is there already
            each.append(_now() - began)
        spent -= calls * np.median(each, axis=0)  # medians, to exclude disturbances
    return float(spent[0]), float(spent[1])


def _now() -> np.ndarray:
    return np.array([time.perf_counter(), time.process_time()])


def rate(built: Simulation, limit: float) -> float:
    """Return the expected seconds of `bare`, from a trial of at most `limit` seconds: more than that where it did not end."""
    try:
        return bare(built, limit)[1]
    except Late:
        return limit * built.planned_time / min(max(built.state.time, 1e-3 * built.planned_time), 0.999 * built.planned_time)


def nudge(state: State, number: int, size: float = NUDGE) -> None:
    """Displace all bodies along the plates and rotate them, at random; each `number` gives other displacements.

    How far runs from such starts part is how far any two runs of a scene can agree.
    """
    from thirdbody.engine.state import refresh_spheres

    rng = np.random.default_rng(number)
    shift = size * state.rayleigh_radius[:, None] * rng.standard_normal((state.n_bodies, 2))
    state.B[:, body.POSITION : body.POSITION + 2] += shift
    q = state.bodies.quaternion
    q += size * rng.standard_normal(q.shape)
    q /= np.linalg.norm(q, axis=1)[:, None]
    refresh_spheres(state)


class Timing(NamedTuple):
    """Seconds, and half the width of the confidence interval of the median."""

    seconds: float
    half: float

    @property
    def relative(self) -> float:
        """Half width over the median."""
        return self.half / self.seconds if self.seconds > 0.0 else math.inf


NOTCH = 1.57  # half width of a notch over IQR/sqrt(n) (McGill, Tukey and Larsen 1978, `timing`)


def timing(values: Sequence[float], single: float = LONE) -> Timing:
    """Return the median and its half width; NaN and infinity without values. `single`: relative half width of a single value.

    Notches NOTCH IQR/sqrt(n), which overlap for equal medians in 95 % of cases (McGill, Tukey and Larsen, The American
    Statistician 32:12, 1978); of fewer than five values half their range.
    """
    n = len(values)
    if n == 0:
        return Timing(math.nan, math.inf)
    middle = statistics.median(values)
    if n < FEW:
        half = max(0.5 * (max(values) - min(values)), single * middle / n)
    else:
        low, _, high = statistics.quantiles(values, n=4, method="inclusive")
        half = NOTCH * (high - low) / math.sqrt(n)
    return Timing(middle, max(half, FLOOR * middle))


def lone(samples: Iterable[Sequence[float]]) -> float:
    """Return the relative half width of a single value: the notch of one value of all samples, each over its median.

    Samples of fewer than FEW values tell nothing; LONE where the others have fewer than MANY values.
    """
    many = [np.asarray(sample) for sample in samples if len(sample) >= FEW]
    known = np.concatenate([sample / np.median(sample) for sample in many]) if many else np.empty(0)
    if len(known) < MANY:
        return LONE
    low, high = np.percentile(known, (25, 75))
    return min(max(NOTCH * float(high - low), KNOWN_LONE), LONE)


def slower(a: Timing, b: Timing) -> bool:
    """Return whether a takes significantly longer than b: their intervals do not overlap."""
    return a.seconds - a.half > b.seconds + b.half


def machine() -> dict[str, Any]:
    """Return processor, kind of core, cores usable by this process, current load of the last minute, system and versions.

    `core`: microarchitecture by LLVM's name, such as znver5; `code_for`: the one that kernels are compiled for, another if
    NUMBA_CPU_NAME names it; `vector_bits` of that code; `caches`: KiB by level, and by how many cores each is shared.
    """
    import llvmlite.binding as llvm
    import numba

    from thirdbody.version import __version__

    own = llvm.get_host_cpu_name()
    target, features = numba.config.CPU_NAME or own, numba.config.CPU_FEATURES or ""  # type: ignore[attr-defined]
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    compiler = llvm.Target.from_default_triple().create_target_machine(cpu=target, features=features)
    assembly = compiler.emit_assembly(llvm.parse_assembly(SUM))
    cpu = platform.processor() or "unknown"
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        cpu = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), cpu)
    return {
        "cpu": cpu,
        "core": own,
        "code_for": target,
        "vector_bits": next((REGISTERS[name] for name in REGISTERS if name in assembly), 64),
        "caches": _caches(),
        "cores": cores(),
        "threads": 1,
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "versions": {
            "thirdbody": __version__, "python": platform.python_version(),
            "numba": numba.__version__, "numpy": np.__version__,
        },
    }  # fmt: skip


def _caches() -> dict[str, dict[str, int]]:
    """Return level -> KiB and number of cores that share it, of the data caches of a core; empty if the system hides them."""
    sizes: dict[str, dict[str, int]] = {}
    for folder in sorted(CACHES.glob("index*")):
        with suppress(OSError):
            names = ("level", "type", "size", "shared_cpu_list")
            level, kind, size, shared = ((folder / name).read_text().strip() for name in names)
            if kind != "Instruction":
                ends = [part.split("-") for part in shared.split(",") if part]  # such as 0-3,8
                number = sum(int(pair[-1]) - int(pair[0]) + 1 for pair in ends)
                sizes[f"L{level}"] = {"KiB": int(size.removesuffix("K")), "cores": number}
    return sizes


def described(report: dict[str, Any]) -> str:
    """Return the processor of a report of `machine` in one line, with its kind of core, vectors and caches."""
    core = report["core"] if report["code_for"] == report["core"] else f"{report['core']}, code for {report['code_for']}"
    sizes = [f", {level} {cache['KiB']} KiB" for level, cache in report["caches"].items()]
    return f"{report['cpu']} ({core}, {report['vector_bits']}-bit vectors{''.join(sizes)})"
