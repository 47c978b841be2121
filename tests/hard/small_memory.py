"""Runs commands of thirdbody, each in a fork of one process, within 2 GB of address space and 20 s of the processor.

`python small_memory.py` reads lines of JSON, the arguments of a command, and answers each with [exit code, standard error];
the code is that of the system, negative, when a command was ended by a signal.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import tempfile
import time

import h5py  # noqa: F401  (what every command imports, so that a fork need not)
import numpy as np  # noqa: F401

MEMORY, SECONDS = 2 << 30, 20
PATIENCE = 15.0 * SECONDS  # wall: a loaded machine is slow, a command that waits for a pipe uses no processor


def run(words: list[str]) -> None:
    """One command in a fork, which does not come back."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    sys.argv = ["thirdbody", *words]
    code = 70
    try:
        from thirdbody.cli.main import main

        main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    finally:
        sys.stderr.flush()
        os._exit(code)


def answer(words: list[str]) -> tuple[int, str]:
    """Exit code and what was said."""
    with tempfile.TemporaryFile() as report:
        child = os.fork()
        if not child:
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, 0), os.dup2(nowhere, 1), os.dup2(report.fileno(), 2)
            run(words)
        end = time.monotonic() + PATIENCE
        while not (found := os.waitpid(child, os.WNOHANG))[0]:
            if time.monotonic() > end:
                os.kill(child, signal.SIGKILL)
            time.sleep(0.005)
        report.seek(0)
        return os.waitstatus_to_exitcode(found[1]), report.read(1_000_000).decode("utf-8", "replace")


if __name__ == "__main__":
    import thirdbody.assembly.simulation  # noqa: F401
    import thirdbody.cli.main  # noqa: F401
    import thirdbody.trajectory.reader  # noqa: F401

    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), flush=True)
