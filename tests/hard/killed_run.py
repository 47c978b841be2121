"""A run for `test_kills.py`, in a process of its own: `python killed_run.py FOLDER SCENE SETTINGS(JSON) N` starts or takes up
the run in a folder, and dies by its own hand at the N-th call that touches the disk (0: never)."""

import json
import os
import signal
import sys
from pathlib import Path

import h5py
import numpy as np
import thirdbody
from thirdbody.runner.checkpoint import FILE
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.run_loop import WallTimes
from thirdbody.runner.simulate import execute, prepare
from thirdbody.trajectory.blocks import Block, Sink

OFTEN = 0.05  # seconds between checkpoints: a run of some seconds writes dozens
PLACES = ((Block, "append"), (Block, "count_frames"), (Block, "add_time"), (h5py.File, "flush"), (Sink, "put"),
          (np, "savez"), (os, "fsync"), (os, "replace"))  # fmt: skip


def die_at(last, places=PLACES):
    """Let the process be killed as it is about to make its so-manieth call that touches the disk."""
    calls = 0

    def watched(owner, name):
        real = getattr(owner, name)

        def call(*args, **options):
            nonlocal calls
            calls += 1
            if calls == last:
                os.kill(os.getpid(), signal.SIGKILL)
            return real(*args, **options)

        setattr(owner, name, call)

    for owner, name in places:
        watched(owner, name)


def go_on(folder, scene, settings, last=0):
    if (folder / FILE).exists():
        simulation, kept = prepare_resume(folder)
    else:
        simulation, kept = prepare(thirdbody.Scene.load(scene).with_settings(settings)), None
    if last:
        die_at(last)
    execute(simulation, folder, overwrite=True, times=WallTimes(OFTEN), checkpoint=kept)


if __name__ == "__main__":
    go_on(Path(sys.argv[1]), sys.argv[2], json.loads(sys.argv[3]), int(sys.argv[4]))
