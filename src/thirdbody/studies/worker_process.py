"""Worker process that computes variants in sequence; a request ends at its deadline, by ending the process if necessary."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from thirdbody.system.child_process import python_command, python_environment

LIMIT = 90.0
"""Time limit of one run of a variant on one core [s]; a run beyond it is marked as such."""

SCENE_FILE, RUNS = "scene.toml", "variants"
"""In the folder of a study: the scene as it is computed, and the runs of its variants."""

PATIENCE = 3600.0
"""Time limit of a request without a deadline [s]."""


class Overdue(Exception):
    """The deadline of a request has passed; its process was ended."""


class Worker:
    """Process of `thirdbody.studies.worker`, started at the first request, and again after it died.

    `started`: seconds of the last start, imports included; `wall`, `cpu`: seconds of all answered requests together.
    """

    def __init__(self) -> None:
        self.started = 0.0
        self.wall = self.cpu = 0.0
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def pace(self) -> float:
        """Wall seconds per second of a core: 1 on an idle machine, more on a shared one."""
        return max(1.0, self.wall / self.cpu) if self.cpu > 0.1 else 1.0

    def start(self, until: float = float("inf")) -> None:
        """Start the process, if it does not run. Raises Overdue at `until` ([s] of `time.perf_counter`)."""
        if self._process is not None:
            return
        began = time.perf_counter()
        self._errors = tempfile.TemporaryFile()
        self._process = subprocess.Popen(
            python_command("thirdbody.studies.worker"), env=python_environment(),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors,
        )  # fmt: skip
        self._buffer = b""
        self._answer(until)  # its message that it is ready
        self.started = time.perf_counter() - began

    def request(self, request: Mapping[str, Any], until: float = float("inf")) -> dict[str, Any]:
        """Return the answer to a request; for a crashed process with that `message`, like a variant that failed.

        Raises Overdue where there is none at `until` ([s] of `time.perf_counter`).
        """
        self.start(until)
        assert self._process is not None and self._process.stdin is not None
        began = time.perf_counter()
        try:
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
            self._process.stdin.flush()
            answer = self._answer(until)
        except BrokenPipeError:
            answer = self._crashed()
        self.wall += time.perf_counter() - began
        self.cpu += answer.get("used_cpu", 0.0)
        return answer

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _answer(self, until: float) -> dict[str, Any]:
        """Return the next line that the process writes."""
        assert self._process is not None and self._process.stdout is not None
        until = min(until, time.perf_counter() + PATIENCE)
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            while b"\n" not in self._buffer:
                left = until - time.perf_counter()
                if left <= 0.0 or not selector.select(left):
                    self.close()
                    raise Overdue
                part = os.read(self._process.stdout.fileno(), 1 << 16)
                if not part:
                    return self._crashed()
                self._buffer += part
        line, self._buffer = self._buffer.split(b"\n", 1)
        return dict(json.loads(line))

    def _crashed(self) -> dict[str, Any]:
        assert self._process is not None
        code = self._process.wait()
        self._errors.seek(0)
        why = (self._errors.read().decode(errors="replace").strip().splitlines() or ["no message"])[-1]
        self.close()
        return {"stable": False, "message": f"the process ended with code {code}: {why}"}


def in_process(
    scene: Path, folder: Path, variants: Sequence[Mapping[str, Any]], plugins: Sequence[str | Path], repeats: int,
    nudge: int = 0,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run the variants of a scene, then time them alternately, in a separate process; return the results (see `worker`).

    The start of the last one is displaced by the number `nudge`, 0 for none.
    """
    with Worker() as worker:
        jobs = [request(scene, folder / str(k), changes, plugins, LIMIT) for k, changes in enumerate(variants)]
        jobs[-1]["nudge"] = nudge
        result = [worker.request({"do": "run", **job}) | {"wall": [], "cpu": []} for job in jobs]
        for report in (report for report in result if report["stable"] and report["cpu_s"] > LONG):
            report["wall"].append(report["wall_s"])
            report["cpu"].append(report["cpu_s"])
        if len({len(report["cpu"]) for report in result if report["stable"]}) > 1:  # only some are long: do not separate pairs
            for report in result:
                report["wall"], report["cpu"] = [], []
        going = [(report, job) for report, job in zip(result, jobs, strict=True) if report["stable"]]
        while going and len(going[0][0]["cpu"]) < repeats:
            for report, job in going:
                answer = worker.request({"do": "time", **job})
                if not answer["stable"]:
                    return result
                report["wall"].append(answer["wall_s"])
                report["cpu"].append(answer["cpu_s"])
    return result


LONG = 2.0
"""Run time on one core above which a run is timed while it also writes its frames, which do not matter there [s]."""


def request(
    scene: Path, folder: Path, changes: Mapping[str, Any], plugins: Sequence[str | Path], limit: float = LIMIT, nudge: int = 0
) -> dict[str, Any]:
    """Return the request to a worker for one variant, from a start displaced by that number (`nudge`), 0 for none."""
    return {"scene": str(scene), "folder": str(folder), "changes": dict(changes), "plugins": [str(path) for path in plugins],
            "limit": limit, "nudge": nudge}  # fmt: skip
