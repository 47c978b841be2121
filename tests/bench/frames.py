"""How long a frame takes to be written and how large it is: `python frames.py [clumps] [frames] [folder]` prints JSON.

The frames have the arrays of a real run (names, types and widths are taken from one of a few bodies) and random values:
10 000 clumps of 6 spheres, three contacts each with a plate, give or take some per cent from frame to frame.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from machine import machine

import thirdbody
from thirdbody.trajectory.schema import BLOCKS, Arrays, Frame
from thirdbody.trajectory.stored_frames import static_arrays, stored_frame
from thirdbody.trajectory.writer import TrajectoryWriter

SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
SMALL = {"debris.0.count": "8", "solver.distance": "0.05 um", "output.every": "0.05 um"}
SPHERES, CONTACTS, SWING = 6, 3, 0.05


def pattern(folder: Path) -> tuple[dict[str, Any], dict[str, dict[str, np.ndarray]], Frame]:
    """Header, static arrays and one frame of a real run."""
    scene = thirdbody.Scene.load(SCENE).with_settings(SMALL)
    with thirdbody.run(scene, out=folder / "pattern", progress=False) as run:
        return run.header, static_arrays(run), stored_frame(run, -1)


def filled(like: Arrays, rows: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Arrays of the same names, types and widths with `rows` rows of random values."""

    def values(array: np.ndarray) -> np.ndarray:
        shape = (rows, *array.shape[1:])
        numbers = rng.normal(size=shape) if array.dtype.kind == "f" else rng.integers(0, 4, shape)
        return numbers.astype(np.float64 if array.dtype.kind == "f" else array.dtype)  # the engine has no float32

    return {name: values(array) for name, array in like.items()}


def frame_like(like: Frame, number: int, clumps: int) -> Frame:
    """Frame `number` of the trial run; the count of contacts changes from frame to frame."""
    rng = np.random.default_rng(number)
    contacts = round(clumps * CONTACTS * (1.0 + SWING * rng.uniform(-1.0, 1.0)))
    rows = {"spheres": clumps * SPHERES, "clumps": clumps, "contacts": contacts, "plates": 8}
    return Frame(number * 1e-6, **{name: filled(like.block(name), rows[name], rng) for name in BLOCKS}, series=like.series)


def measure(folder: Path, clumps: int, frames: int) -> dict[str, Any]:
    """Seconds of `append` frame by frame, bytes of the file, and of the arrays in the types that are stored."""
    header, static, like = pattern(folder)
    rng = np.random.default_rng(0)
    rows = {"spheres": clumps * SPHERES, "clumps": clumps}
    static = {name: filled(arrays, rows[name], rng) for name, arrays in static.items()}
    path, seconds, work, plain, payload = folder / "run.vtkhdf", [], [], [], 0
    once = sum(array.nbytes for arrays in static.values() for array in arrays.values())
    with TrajectoryWriter(path, header, static) as writer, open(folder / "bare", "wb", buffering=0) as bare:
        for number in range(frames):
            frame = frame_like(like, number, clumps)
            size = stored_bytes(frame)
            payload += size
            started, busy = time.perf_counter(), time.process_time()
            writer.append(frame)
            seconds.append(time.perf_counter() - started)
            work.append(time.process_time() - busy)
            plain.append(bare_write(bare, size))
    size = path.stat().st_size
    return {
        "clumps": clumps,
        "spheres": clumps * SPHERES,
        "frames": frames,
        "append_ms": spread(seconds),
        "append_cpu_ms": spread(work),
        "payload_bytes_per_frame": payload / frames,
        "file_bytes_per_frame": (size - once) / frames,
        "static_bytes": once,
        "file_over_payload": size / (payload + once),
        "bare_write_ms": spread(plain),
        "machine": machine(),
    }


def stored_bytes(frame: Frame) -> int:
    """Bytes of a frame's arrays as they are stored: velocities of spheres in single precision."""
    total = sum(array.nbytes for name in BLOCKS for array in frame.block(name).values())
    return total - frame.spheres["velocity"].nbytes // 2


def bare_write(file: BinaryIO, size: int) -> float:
    """Seconds to append as many bytes to a plain file, for comparison: noise of the system strikes both."""
    data = np.random.default_rng(size).bytes(size)
    started = time.perf_counter()
    file.write(data)
    return time.perf_counter() - started


def spread(seconds: list[float]) -> dict[str, Any]:
    """Median, quartiles and the largest, ms."""
    low, median, high = (1e3 * np.percentile(seconds, [25, 50, 75])).tolist()
    return {"median": median, "quartiles": [low, high], "largest": 1e3 * max(seconds)}


if __name__ == "__main__":
    given = sys.argv[1:]
    with tempfile.TemporaryDirectory(dir=given[2] if len(given) > 2 else None) as name:
        print(json.dumps(measure(Path(name), *(int(n) for n in (given + ["10000", "60"][len(given) :])[:2])), indent=1))
