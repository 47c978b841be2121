"""What the guards of a run cost: the engine as it is and the same engine without them, in turn from the same state.

`python tests/bench/peers.py --guards` starts this file once for each of the two engines; the two then run segment by segment, one
at a time, on the same core. The engine without guards is a copy of the package from which the code of the guards is taken out
(`CUTS`), with a compiler's cache of its own. Both must come to the same bits after every segment.

What is taken out. In every step: overlap over radius, way over radius, bodies outside the domain, numbers that are not finite.
After every 64th: the energy balance and the lengths of quaternions, as a run looks at them (`RunLoop`), and the record of the
contacts in that step, which only this look reads.

What stays. The longest way of a step, which tells when to search. The sums of work and power and the ledger, which outputs tell.
The bound of the time step, which is asked for every 64 steps. The looks behind outputs are taken out but not run: nothing is
written while it is timed, and a frame is far more work.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from ours import tiles
from rich.console import Console
from rich.table import Table
from theirs import PINNED

import thirdbody

SCENES = "S2000,C2000,T2000"
AS_IS, WITHOUT = "with guards", "without"
PACKAGE = Path(thirdbody.__file__).resolve().parent


class Cut(NamedTuple):
    """A text that stands exactly once in a file of the package, and what stands there without guards."""

    file: str
    text: str
    instead: str = ""


CUTS = (
    # way over radius, numbers, domain; the longest way stays
    Cut("kernels/explicit/drift.py", """\
    body = b if relative_distance > step else body
    bad, out = check_position(b, x, relative_distance, limits, bad, out)
    return max(longest, distance), max(step, relative_distance), body, bad, out
""", """\
    return max(longest, distance), step, body, bad, out
"""),
    Cut("kernels/explicit/drift_spheres.py", """\
        max(fastest, square), max(farthest, square * extract(fraction, 2) * extract(fraction, 2)), strange + none * x,
        select_greater(low, x, x, low), select_greater(x, high, x, high),
""", """\
        max(fastest, square), farthest, strange, low, high,
"""),
    # overlap over radius, forces; the sums stay
    Cut("kernels/explicit/contact_forces.py", """\
        r_i, r_j = get(G, q + geometry.RADIUS * TILE), get(G, q + geometry.PARTNER_RADIUS * TILE)
        if (
            less_mask(broadcast(max_overlap) * select_greater(r_i, r_j, r_j, r_i), get(I, q + law_input.OVERLAP * TILE)) != 0
        ):  # few are the deepest
            max_overlap, slot = larger_overlap(q, min(q + LANES, m), slots, tile, max_overlap, slot)
        x = get(G, q + geometry.FORCE * TILE)
        y = get(G, q + (geometry.FORCE + 1) * TILE)
        z = get(G, q + (geometry.FORCE + 2) * TILE)
        if not all_below(x * x + y * y + z * z, LARGEST):
            bad = last_nonfinite(q, min(q + LANES, m), slots, G, bad)
"""),
    Cut("kernels/explicit/step_loop.py", """\
        code, who = guard(D, context.sums, context.moves)
        if code != Stop.DONE:
            return code, who, pending
"""),
    # energy and quaternions; what the scene is at its start stays recorded
    Cut("kernels/explicit/step_loop.py", "sampled or last or n == budget - 1", "sampled or last or dt == 0.0"),
    Cut("runner/run_loop.py", "self.energy_guard.check(state, self.ledger.watch(state))\n", "pass\n"),
    Cut("runner/run_loop.py", "self.energy_guard.check(simulation.state, stored)\n", "pass\n"),
)  # fmt: skip


# -- the engine without guards --


def without_guards(folder: Path) -> Path:
    """A copy of the package in a folder, without its guards. Exits with a message if a text of `CUTS` is not found once."""
    copy = folder / PACKAGE.name
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for cut in CUTS:
        file = copy / cut.file
        source = file.read_text(encoding="utf-8")
        if source.count(cut.text) != 1:
            first = cut.text.strip().splitlines()[0]
            sys.exit(f"--guards: the bench no longer knows the code: `{first}` and what follows is not found once in {cut.file}")
        file.write_text(source.replace(cut.text, cut.instead), encoding="utf-8")
    return copy


# -- one engine, in a process of its own --


class Engine:
    """The scene after its warm-up, to which every segment goes back."""

    def __init__(self, start: Any, warm: int, steps: int) -> None:
        from ours import advance
        from peers_scenes import simulation_of

        from thirdbody.runner.run_folder import RunFolder
        from thirdbody.runner.run_loop import RunLoop, WallTimes
        from thirdbody.runner.simulate import set_threads

        set_threads(1)
        self.steps, self.looking = steps, 0.0
        self.simulation = simulation_of(start)
        self.state, self.integrator = self.simulation.state, self.simulation.integrator
        self.conduct = RunLoop(self.simulation, RunFolder(Path()), times=WallTimes(math.inf))  # writes nothing
        advance(self.simulation, warm)
        self.retained = self.snapshot()

    def snapshot(self) -> Any:
        """The state of now, in arrays of its own."""
        from thirdbody.engine.snapshot import Snapshot, snapshot

        now = snapshot(self.state, self.integrator, self.conduct.ledger)
        return Snapshot({name: array.copy() for name, array in now.arrays.items()}, now.notes)

    def go_back(self) -> None:
        """To the state after the warm-up."""
        from thirdbody.engine.snapshot import Snapshot, restore

        arrays = {name: array.copy() for name, array in self.retained.arrays.items()}  # a run takes some of them for its own
        restore(Snapshot(arrays, self.retained.notes), self.state, self.integrator, self.conduct.ledger)
        self.conduct.energy_guard.above = 0

    def segment(self) -> dict[str, Any]:
        """Seconds per step of the wall and of the processor, seconds of them for looks between the calls, and the end's bits."""
        self.go_back()
        self.looking = 0.0
        before = self.integrator.summary()["steps"]
        began, busy = time.perf_counter(), time.process_time()
        self._advance(self.steps)
        wall, processor = time.perf_counter() - began, time.process_time() - busy
        taken = self.integrator.summary()["steps"] - before
        return {"t": wall / taken, "processor": processor / taken, "looks": self.looking / taken, "bits": self.bits()}

    def trip(self) -> dict[str, Any]:
        """Whether a limit that every body exceeds stops the run, and what a step saw: largest overlap and way over radius."""
        from thirdbody.errors import GuardStop
        from thirdbody.kernels.columns import chunk_motion, contact_sums, domain

        self.go_back()
        limit, self.state.D[domain.TRAVEL_GUARD] = float(self.state.D[domain.TRAVEL_GUARD]), 0.0
        stopped = False
        try:
            self._advance(1)
        except GuardStop:
            stopped = True
        self.state.D[domain.TRAVEL_GUARD] = limit
        sums, moves = self.integrator.sums, self.integrator.moves
        return {
            "stopped": stopped,
            "seen": [float(sums[:, contact_sums.MAX_OVERLAP].max()), float(moves[:, chunk_motion.MAX_TRAVEL].max())],
        }

    def bits(self) -> str:
        """A fingerprint of the state and its ledger. Of records only those of loaded contacts count: others are left over."""
        from thirdbody.kernels.columns import contact_state

        now = self.snapshot()
        now.arrays["slots_R"][now.arrays["slots_H"][:, contact_state.SLIP] <= 0.0] = 0.0
        digest = hashlib.sha256(repr((now.notes["dt"], now.notes["searches"])).encode())
        for name in sorted(now.arrays):
            digest.update(name.encode() + now.arrays[name].tobytes())
        return digest.hexdigest()

    def _advance(self, steps: int) -> None:
        self.integrator.advance_to(time=self.state.time + (steps - 0.5) * self.state.dt, watch=self._watch)

    def _watch(self) -> None:
        began = time.perf_counter()
        self.conduct._watch()
        self.looking += time.perf_counter() - began


def main() -> None:
    """One of the two engines: a command a line, an answer a line."""
    parser = argparse.ArgumentParser(description="one engine of peers.py --guards, which takes `segment` and `trip` from stdin")
    parser.add_argument("kind", choices=["S", "C", "T"])
    parser.add_argument("number", type=int)
    parser.add_argument("--peers", type=Path, metavar="DIR")
    parser.add_argument("--tiles", type=tiles, default="1x1")
    parser.add_argument("--warm", type=int, required=True)
    parser.add_argument("--steps", type=int, required=True)
    requested = parser.parse_args()
    engine = Engine(
        start_from(requested.kind, requested.number, requested.tiles, requested.peers), requested.warm, requested.steps
    )
    print(json.dumps({"package": str(PACKAGE), "spheres": engine.state.n_spheres, "bodies": engine.state.n_bodies}), flush=True)
    answers = {"segment": engine.segment, "trip": engine.trip}
    for line in sys.stdin:
        print(json.dumps(answers[line.strip()]()), flush=True)


def start_from(kind: str, number: int, copies: tuple[int, int], peers: Path | None) -> Any:
    """The configuration of a scene: of the peers' folder, else generated. Raises OSError without the file."""
    from peers_scenes import generated, read, start_of, tiled

    if peers is not None:
        return read(peers / "configs" / f"{kind}_{number}.npz", copies)
    return start_of(kind, tiled(generated(number), *copies))


# -- the pair --


class Worker:
    """An engine's process. Exits with a message when it fails; its words are on stderr."""

    def __init__(self, name: str, package: Path, case: Any, peers: Path | None, cache: Path | None, pinned: bool) -> None:
        self.name, self.case = name, case
        command = [*(PINNED[1] if pinned and shutil.which("taskset") else ()), sys.executable, str(Path(__file__).resolve())]
        command += [case.kind, str(case.number), "--tiles", case.tiles, "--warm", str(case.warm), "--steps", str(case.steps)]
        command += ["--peers", str(peers.resolve())] if peers else []
        paths = [str(package.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)} | ({"THIRDBODY_CACHE": str(cache)} if cache else {})
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment, cwd=package.parent
        )
        self.reported = self._answer()
        if Path(self.reported["package"]) != package:
            sys.exit(f"{case.name}: the engine {name} is that of {self.reported['package']}")

    def request(self, command: str) -> dict[str, Any]:
        """The answer to `segment` or `trip`."""
        assert self.process.stdin is not None
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()
        return self._answer()

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            sys.exit(f"{self.case.name}: the engine {self.name} ended with status {self.process.wait()}")
        return json.loads(line)


@contextmanager
def both(case: Any, peers: Path | None, folder: Path, pinned: bool = True) -> Iterator[dict[str, Worker]]:
    """The two engines; that without guards lies in a folder, with its cache."""
    workers: dict[str, Worker] = {}
    try:
        workers[AS_IS] = Worker(AS_IS, PACKAGE, case, peers, None, pinned)
        workers[WITHOUT] = Worker(WITHOUT, folder / PACKAGE.name, case, peers, folder / "cache", pinned)
        yield workers
    finally:
        for worker in workers.values():
            worker.close()


def measure_guards(cases: Iterable[Any], rounds: int, peers: Path | None) -> list[dict[str, Any]]:
    """For each scene: all segments of both engines, pair by pair, with the ratios of their times. Every round has processes of
    its own, and every second pair begins with the other engine. Exits with a message where the two engines differ."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        without_guards(folder)
        for case in cases:
            runs: dict[str, list[list[dict[str, Any]]]] = {AS_IS: [], WITHOUT: []}
            with both(case, peers, folder, pinned=False) as workers:  # compiles on all cores
                verify_trips(case, workers)
            for k in range(rounds):
                print(f"{case.name}, guards: round {k + 1} of {rounds}", file=sys.stderr, flush=True)
                with both(case, peers, folder) as workers:
                    pairs = [pair(case, workers, turned=(k + n) % 2 == 1) for n in range(case.reps)]
                    size = {key: workers[AS_IS].reported[key] for key in ("spheres", "bodies")}
                for engine in runs:
                    runs[engine].append([one[engine] for one in pairs])
            rows.append({"scene": case.name, **vars(case), **size, "runs": runs, **summed_up(runs)})
    return rows


def pair(case: Any, workers: dict[str, Worker], turned: bool = False) -> dict[str, dict[str, Any]]:
    """A segment of each engine from the same state. Exits with a message unless both come to the same bits."""
    names = [WITHOUT, AS_IS] if turned else [AS_IS, WITHOUT]
    report = {name: workers[name].request("segment") for name in names}
    if report[AS_IS]["bits"] != report[WITHOUT]["bits"]:
        sys.exit(f"{case.name}: the two engines do not come to the same bits: more than guards is taken out")
    return report


def verify_trips(case: Any, workers: dict[str, Worker]) -> None:
    """Exits with a message unless the engine as it is stops where it must and the other one goes on and looks at nothing."""
    report = {name: worker.request("trip") for name, worker in workers.items()}
    if (
        not report[AS_IS]["stopped"]
        or report[WITHOUT]["stopped"]
        or any(report[WITHOUT]["seen"])
        or not any(report[AS_IS]["seen"])
    ):
        sys.exit(f"{case.name}: with a limit of 0 {report[AS_IS]} is told by the engine with guards, {report[WITHOUT]} without")


def summed_up(runs: dict[str, list[list[dict[str, Any]]]]) -> dict[str, Any]:
    """Ratios with guards to without, pair by pair, of the wall and of the processor; the share of looks in the time with them."""
    report: dict[str, Any] = {}
    for name, key in (("ratio", "t"), ("of_processor", "processor")):
        ratios = [
            [own[key] / bare[key] for own, bare in zip(*pairs, strict=True)]
            for pairs in zip(runs[AS_IS], runs[WITHOUT], strict=True)
        ]
        medians = [statistics.median(ratio) for ratio in ratios]
        every = statistics.median(ratio for one in ratios for ratio in one)
        report[name] = {"median": every, "min": min(medians), "max": max(medians), "pairs": ratios}
    guard = [one["looks"] / one["t"] for run in runs[AS_IS] for one in run]
    return report | {"looks": statistics.median(guard)}


def print_guards(rows: Sequence[dict[str, Any]], console: Console) -> None:
    """A scene a line."""
    table = Table("scene", "pairs", *(f"ns/sphere-step {name}" for name in (AS_IS, WITHOUT)), "with/without", "of the processor",
                  "looks", "CPU", title="guards, one thread: median of pairs (least .. largest median of a round)")  # fmt: skip
    for row in rows:
        runs = {name: [one for run in row["runs"][name] for one in run] for name in (AS_IS, WITHOUT)}
        table.add_row(
            row["scene"], f"{len(row['runs'][AS_IS])} x {row['reps']} of {row['steps']} steps",
            *(f"{1e9 / row['spheres'] * statistics.median(one['t'] for one in runs[name]):.4g}" for name in runs),
            *(f"{row[key]['median']:.3f}  ({row[key]['min']:.3f} .. {row[key]['max']:.3f})" for key in ("ratio", "of_processor")),
            f"{row['looks']:.1%}", f"{min(one['processor'] / one['t'] for run in runs.values() for one in run):.0%}",
        )  # fmt: skip
    console.print(table)
    console.print("looks: at energy balance and quaternions after every 64th step, in the time with guards")
    console.print("both engines ended every segment with the same bits")


if __name__ == "__main__":
    main()
