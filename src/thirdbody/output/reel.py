"""The second process: takes the shots that a job names, has them drawn and writes the file whole.

Runs where VTK may crash (`render`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial, reduce
from operator import or_
from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.output.canvas import pixels_of, save
from thirdbody.output.closeup import compose_close_up, make_close_plan
from thirdbody.output.film import gif, mp4
from thirdbody.output.film_progress import DRAWN
from thirdbody.output.picture import compose, make_plan
from thirdbody.output.run import Run, open_run
from thirdbody.output.shot import take_shot
from thirdbody.output.spots import take_close_up
from thirdbody.output.target import write_whole


def draw_run(job: dict[str, Any]) -> None:
    """Draw the frames of a job, as `render` checked it, into its file. Raises OSError when that cannot be written."""
    file, size = Path(job["file"]), tuple(job["size"])
    with open_run(job["run"]) as run:
        windows = _windows(run, job, size)
        if file.suffix.lower() == ".png":
            save(next(windows), file, size, origin(run, job))
            return
        encode = {".gif": gif, ".mp4": mp4}[file.suffix.lower()]
        write_whole(file, encode(_pictures(windows, size), job["fps"]))


OPTIONS = ("color", "size", "zoom", "view", "forces", "body")
"""What of a job changes the look of a still."""


def origin(run: Run, job: dict[str, Any]) -> dict[str, str]:
    """What a still was drawn from, for the text chunks of its PNG: title, frame, time, options, the resolved scene as TOML."""
    number = job["frames"][-1]
    texts = {
        "Software": "thirdbody",
        "Title": str(run.header.get("title", "")),
        "frame": f"{number} of 0 to {run.frames - 1}",
        "time": f"{float(run.times[number])!r} s",
        "options": json.dumps({name: job[name] for name in OPTIONS}),
        "scene": run.scene_text,
    }
    return {keyword: _in_ascii(text) for keyword, text in texts.items()}


def _in_ascii(text: str) -> str:
    """Other letters as TOML escapes: text chunks of PNG know Latin-1 only."""
    return "".join(letter if letter.isascii() else f"\\U{ord(letter):08x}" for letter in text)


def _pictures(windows: Iterator[Any], size: tuple[int, int]) -> Iterator[np.ndarray]:
    for number, window in enumerate(windows, start=1):
        yield pixels_of(window, size)
        print(f"{DRAWN}{number}", flush=True)


def _windows(run: Run, job: dict[str, Any], size: tuple[int, int]) -> Iterator[Any]:
    """The window, once per frame, all by one plan: only what moves in the run moves in the film."""
    numbers, color = job["frames"], job["color"]
    scale = reduce(or_, (take_shot(run, number, color).legend.scale for number in numbers))
    window = None
    if job["body"] is not None:
        close = partial(take_close_up, run, body=job["body"], color=color, scale=scale)
        near = make_close_plan((close(number) for number in numbers), size, job["view"], job["fixed"])
        for number in numbers:
            window = compose_close_up(close(number), near, window)
            yield window
        return
    shot = partial(take_shot, run, color=color, forces=job["forces"], scale=scale)
    plan = make_plan((shot(number) for number in numbers), size, job["view"], job["zoom"])
    for number in numbers:
        window = compose(shot(number), plan, window)
        yield window
