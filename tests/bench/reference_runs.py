"""Short runs of every driver, level, effect, measure, support and motion, by which a change of the engine is judged: same bits?

    python tests/bench/reference_runs.py run -o before.json [--threads N] [--only NAME ...]
    python tests/bench/reference_runs.py compare before.json after.json     # exit status 0: all bits are equal

Stands on the public interface only, so that it runs unchanged with older and newer engines. Per scene the file has the SHA-256 of
every array and every text of `run.vtkhdf`, with a few numbers by which a difference is told in size. Left out are the places of
data within the file, and of its texts those that depend on time, machine or version: `versions`, the reason for the choice of
an integrator, and of the summary `wall_time` and `sphere_steps_per_second`. Bits of two kinds of processor need not be equal."""

import argparse
import gc
import hashlib
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from reference_scenes import BALANCE, BALANCES, FILES, SCENES, Tables, tables_of
import thirdbody

NAMES = (*SCENES, *BALANCES)
CHANGING = {"wall_time", "sphere_steps_per_second"}  # entries of the summary that depend on time or machine
WORST, SKETCHES = 4, 8
"""Arrays and figures of a scene that are told one by one. Sums of an array with random signs: from their differences follows the
rms difference of two arrays, to about a fourth."""


def described(values: Any) -> Tables:
    """Return the digest of an array, and the numbers by which a difference is told in size."""
    array = np.asarray(values)
    report: Tables = {"sha256": hashlib.sha256(_bytes(array)).hexdigest(), "shape": list(array.shape), "dtype": str(array.dtype)}
    if array.dtype.kind not in "biuf" or not array.size:
        return report
    flat = array.astype(np.float64).ravel()
    finite = np.isfinite(flat)
    flat = np.where(finite, flat, 0.0)
    signs = np.where(np.random.default_rng(1).random((SKETCHES, len(flat))) < 0.5, -1.0, 1.0)
    numbers = {"min": flat.min(), "max": flat.max(), "sum": flat.sum(), "rms": np.sqrt(np.mean(flat**2))}
    return report | {name: float(value) for name, value in numbers.items()} | {
        "not_finite": int(len(flat) - finite.sum()), "sketch": (signs @ flat).tolist(),
    }  # fmt: skip


def _bytes(array: np.ndarray) -> bytes:
    return repr(array.tolist()).encode() if array.dtype.kind == "O" else np.ascontiguousarray(array).tobytes()


def contents(path: Path) -> tuple[Tables, dict[str, str]]:
    arrays: Tables = {}
    texts: dict[str, str] = {}

    def visit(name: str, node: Any) -> None:
        arrays.update({f"{name}@{key}": described(value) for key, value in node.attrs.items()})
        if isinstance(node, h5py.Dataset):
            if not name.startswith("scene/"):
                arrays[name] = described(node[()])
            elif name not in ("scene/versions", "scene/summary"):  # what the latter says is compared number by number
                texts[name] = hashlib.sha256(_bytes(np.asarray(node[()]))).hexdigest()

    with h5py.File(path) as file:
        visit("", file)
        file.visititems(visit)
    return arrays, texts


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict | list | tuple):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            if key not in CHANGING:
                yield from leaves(part, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


def driver() -> str:
    """Return the class that advances the run, found in the calls that lead here; its name is no public interface."""
    frame = sys._getframe(1)
    while frame is not None:
        for value in frame.f_locals.values():
            if type(value).__module__.startswith("thirdbody.") and hasattr(type(value), "advance_to"):
                return type(value).__name__
        frame = frame.f_back  # type: ignore[assignment]
    return ""


def compile_clock() -> Callable[[], float]:
    """Return a clock of the seconds in which numba compiled in this process; loading from the cache does not count."""
    from numba.core import event

    listener = event.TimingListener()
    event.register("numba:compile", listener)
    return lambda: float(listener.duration) if listener.done else 0.0


def simulate(name: str, threads: int | None, compiler: Callable[[], float]) -> Tables:
    marks: Tables = {}

    def report(_: Any) -> None:
        if not marks:
            marks.update(driver=driver(), compiled=compiler(), busy=time.process_time(), first=time.perf_counter())

    gc.collect()
    folder = Path("runs") / name
    compiled, begun = compiler(), time.perf_counter()
    run = thirdbody.run(tables_of(SCENES[name]), out=folder, threads=threads, progress=report)
    ended, busy = time.perf_counter(), time.process_time()
    arrays, texts = contents(folder / "run.vtkhdf")
    summary = dict(leaves(run.summary()))
    codes = np.bincount(run.states[-1], minlength=len(run.state_names)).tolist()
    return {
        "driver": marks["driver"], "integrator": run.header.get("integrator", {}).get("name", ""),
        "friction": {"value": run.friction.value, "error": run.friction.error},
        "states": dict(zip(run.state_names, codes, strict=True)), "energy_residual": summary.get("energy_residual"),
        "seconds": {
            "integration": ended - marks["first"] - (compiler() - marks["compiled"]),  # with the frames that it writes
            "processor": busy - marks["busy"],  # in that time, of all threads
            "before_first_frame": marks["first"] - begun, "compiling": compiler() - compiled, "total": ended - begun,
        },
        "arrays": arrays, "texts": texts, "summary": summary,
    }  # fmt: skip


def balance(name: str, compiler: Callable[[], float]) -> Tables:
    level = {"balance_mdr": "mdr"}.get(name, "exact")
    compiled, begun = compiler(), time.perf_counter()
    result = thirdbody.balance(BALANCE | BALANCES[name], level).to_dict()
    total = time.perf_counter() - begun
    points = [dict(leaves(point)) for point in result.pop("points")]
    labels = [point["label"] for point in points]
    arrays = {key: described([point.get(key, math.nan) for point in points]) for key in points[-1]}
    compiling = compiler() - compiled
    return {
        "driver": "balance", "states": {label: labels.count(label) for label in sorted(set(labels))},
        "seconds": {"integration": total - compiling, "compiling": compiling, "total": total},
        "arrays": arrays, "summary": dict(leaves(result)),
    }  # fmt: skip


def environment() -> Tables:
    import llvmlite.binding
    import numba

    def git(*words: str) -> str:
        command = ["git", "-C", str(Path(thirdbody.__file__).parent), *words]
        done = subprocess.run(command, capture_output=True, text=True)
        return done.stdout.strip() if done.returncode == 0 else ""

    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "commit": git("rev-parse", "HEAD"), "changed": bool(git("status", "--porcelain", "-uno")),
        "thirdbody": thirdbody.__version__, "numpy": np.__version__, "numba": numba.__version__, "h5py": h5py.__version__,
        "python": platform.python_version(), "processor": models[0] if models else platform.processor(),
        "code_for": os.environ.get("NUMBA_CPU_NAME") or llvmlite.binding.get_host_cpu_name(), "cores": os.cpu_count(),
    }  # fmt: skip


def run_all(out: Path, threads: int | None, names: list[str]) -> int:
    """Run the scenes into a folder that is removed, and write the report; returns the number that failed."""
    out, before, compiler = out.absolute(), Path.cwd(), compile_clock()
    scenes: Tables = {}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # files of scenes are named without a folder: the text of a scene is the same everywhere
        try:
            for name, text in FILES.items():
                Path(name).write_text(text, encoding="utf-8")
            for name in names:
                try:
                    scenes[name] = balance(name, compiler) if name in BALANCES else simulate(name, threads, compiler)
                except Exception as error:  # a scene that an engine refuses is a difference, not the end
                    scenes[name] = {"error": f"{type(error).__name__}: {error}"}
                print(line_of(name, scenes[name]), flush=True)
        finally:
            os.chdir(before)
    report = {"environment": environment() | {"threads": threads}, "scenes": scenes}
    out.write_text(json.dumps(report, indent=1), encoding="utf-8")
    return sum("error" in scene for scene in scenes.values())


def line_of(name: str, scene: Tables) -> str:
    if "error" in scene:
        return f"{name:32} {scene['error']}"
    seconds, states = scene["seconds"], ", ".join(f"{count} {state}" for state, count in scene["states"].items() if count)
    before = seconds.get("before_first_frame", 0.0)
    return (
        f"{name:32} {scene['driver']:27} {before:6.2f} s before the first frame ({seconds['compiling']:.2f} s compiling), "
        f"{seconds['integration']:5.2f} s integration; {states}"
    )


def difference(one: Tables, other: Tables) -> tuple[float, str]:
    """Return how far two arrays are apart, relative to their size, with words; infinite where that has no sense."""
    for key in ("shape", "dtype", "not_finite"):
        if one.get(key) != other.get(key):
            return math.inf, f"{key} {one.get(key)} -> {other.get(key)}"
    if "sketch" not in one:
        return math.inf, "differs"
    count = max(math.prod(one["shape"]), 1)
    squares = [(a - b) ** 2 for a, b in zip(one["sketch"], other["sketch"], strict=True)]
    size, apart = max(one["rms"], other["rms"]), math.sqrt(statistics.fmean(squares) / count)
    changes = [f"{key} {one[key]:.10g} -> {other[key]:.10g}" for key in ("min", "max", "sum") if one[key] != other[key]]
    return (apart / size if size else 0.0), "; ".join(changes)


def compare_arrays(one: Tables, other: Tables) -> list[str]:
    lines = []
    for title, names in (("missing", one.keys() - other.keys()), ("new", other.keys() - one.keys())):
        if names:
            lines.append(f"{len(names)} arrays {title}: {', '.join(sorted(names))}")
    names = [name for name in one if name in other and one[name]["sha256"] != other[name]["sha256"]]
    found = sorted(((*difference(one[name], other[name]), name) for name in names), reverse=True)
    if found:
        middle = statistics.median_low([size for size, _, _ in found])
        lines.append(f"{len(found)} of {len(one)} arrays differ, in the median by {middle:.1e} of their rms value")
    return lines + [f"  {name}: {size:.1e}; {words}" for size, words, name in found[:WORST]]


def changed(one: Tables, other: Tables) -> list[str]:
    return [name for name in one | other if repr(one.get(name)) != repr(other.get(name))]


def compare_scene(one: Tables, other: Tables, numbers_only: bool) -> list[str]:
    """Return lines on what differs in a scene; no lines: all bits are equal."""
    if "error" in one or "error" in other:
        return [f"{one.get('error', 'ran')} -> {other.get('error', 'ran')}"]
    lines = compare_arrays(one["arrays"], other["arrays"])
    for key in ("friction", "states", "energy_residual"):
        if repr(one.get(key)) != repr(other.get(key)):
            lines.append(f"  {key}: {one.get(key)} -> {other.get(key)}")
    names = changed(one["summary"], other["summary"])
    if numbers_only:
        names = [name for name in names if not isinstance(other["summary"].get(name), str)]
    lines += [f"{len(names)} entries of the summary differ"] if names else []
    lines += [f"  {name}: {one['summary'].get(name)} -> {other['summary'].get(name)}" for name in names[:WORST]]
    texts = changed(one.get("texts", {}), other.get("texts", {}))
    return lines + ([f"texts differ: {', '.join(texts)}"] if texts and not numbers_only else [])


def compare(before: Tables, after: Tables, numbers_only: bool) -> int:
    """Print what differs between two reports; returns 0 if all bits are equal."""
    for key in changed(before["environment"], after["environment"]):
        print(f"{key}: {before['environment'].get(key)} -> {after['environment'].get(key)}")
    scenes, others = before["scenes"], after["scenes"]
    for title, names in (("missing", scenes.keys() - others.keys()), ("new", others.keys() - scenes.keys())):
        if names:
            print(f"scenes {title}: {', '.join(sorted(names))}")
    both, equal = [name for name in scenes if name in others], 0
    for name in both:
        lines = compare_scene(scenes[name], others[name], numbers_only)
        equal += not lines
        drivers = scenes[name].get("driver"), others[name].get("driver")
        lines += [f"driver {drivers[0]} -> {drivers[1]}"] if drivers[0] != drivers[1] else []  # a name is no bit of a result
        if lines:
            print("\n    ".join([f"{name}:", *lines]))
    print(f"{equal} of {len(both)} scenes have equal bits")
    print_seconds([(scenes[name].get("seconds", {}), others[name].get("seconds", {})) for name in both])
    return int(equal < len(both) or scenes.keys() != others.keys())


def print_seconds(pairs: list[tuple[Tables, Tables]]) -> None:
    for key in ("integration", "processor", "before_first_frame", "compiling", "total"):
        times = [(one[key], other[key]) for one, other in pairs if key in one and key in other]
        ratios = [other / one for one, other in times if one > 0.0]
        ratio = f"{statistics.median(ratios):.3f}" if ratios else "-"
        print(f"seconds, {key}: {sum(a for a, _ in times):.2f} -> {sum(b for _, b in times):.2f}, median ratio {ratio}")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run", help="run the scenes and write a report")
    runs.add_argument("-o", "--out", type=Path, required=True)
    runs.add_argument("--threads", type=int)
    runs.add_argument("--only", nargs="+", choices=NAMES, default=list(NAMES), metavar="NAME")
    two = commands.add_parser("compare", help="tell what differs between two reports; exit status 1 if any bit does")
    two.add_argument("before", type=Path)
    two.add_argument("after", type=Path)
    two.add_argument("--numbers-only", action="store_true", help="texts of the run file may differ")
    given = parser.parse_args()
    if given.command == "run":
        return int(run_all(given.out, given.threads, given.only) > 0)
    reports = [json.loads(path.read_text(encoding="utf-8")) for path in (given.before, given.after)]
    return compare(reports[0], reports[1], given.numbers_only)


if __name__ == "__main__":
    sys.exit(main())
