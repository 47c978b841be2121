"""Drawing process of a run: draws the frames of a job and writes the file whole. VTK may crash here (`render`)."""

import json
from collections.abc import Callable, Iterator
from functools import partial, reduce
from operator import or_
from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.atomic_files import write_whole
from thirdbody.render.canvas import Canvas, save_png
from thirdbody.render.closeup import compute_close_up_layout, draw_close_up
from thirdbody.render.closeup_data import read_close_up
from thirdbody.render.film import gif, mp4
from thirdbody.render.film_progress import DRAWN
from thirdbody.render.layout import compute_layout, draw_picture
from thirdbody.render.picture_data import read_picture_data
from thirdbody.trajectory.reader import Run, open_run


def draw_run(job: dict[str, Any]) -> None:
    """Draw the frames of a job, as `render` checked it, into its file. Raises OSError when that cannot be written."""
    file, size = Path(job["file"]), tuple(job["size"])
    with open_run(job["run"]) as run, Canvas(size) as canvas:
        pictures = _draw_pictures(run, job, canvas)
        if file.suffix.lower() == ".png":
            save_png(next(pictures), file, origin(run, job))
        else:
            write_whole(file, {".gif": gif, ".mp4": mp4}[file.suffix.lower()](_reported(pictures), job["fps"]))


OPTIONS = ("color", "size", "zoom", "view", "forces", "body")
"""Keys of a job that change the look of a still."""


def origin(run: Run, job: dict[str, Any]) -> dict[str, str]:
    """Return the origin of a still for its PNG text chunks: title, frame, time, options, the resolved scene as TOML."""
    number = job["frames"][-1]
    return {
        "Software": "thirdbody",
        "Title": str(run.header.get("title", "")),
        "frame": f"{number} of 0 to {run.frames - 1}",
        "time": f"{float(run.times[number])!r} s",
        "options": json.dumps({name: job[name] for name in OPTIONS}),
        "scene": run.scene_text,
    }


def _reported(pictures: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
    """Yield the same pictures, each reported on standard output when it is drawn."""
    for number, picture in enumerate(pictures, start=1):
        yield picture
        print(f"{DRAWN}{number}", flush=True)


def _draw_pictures(run: Run, job: dict[str, Any], canvas: Canvas) -> Iterator[np.ndarray]:
    """Yield the picture of each frame, all in one layout: only what moves in the run moves in the film."""
    numbers, color = job["frames"], job["color"]
    scale = reduce(or_, (read_picture_data(run, number, color).legend.scale for number in numbers))
    if job["body"] is None:
        read: Callable[[int], Any] = partial(read_picture_data, run, color=color, forces=job["forces"], scale=scale)
        layout = compute_layout(map(read, numbers), canvas.size, job["view"], job["zoom"])
        draw: Callable[[Any], None] = partial(draw_picture, canvas, layout)
    else:
        read = partial(read_close_up, run, body=job["body"], color=color, scale=scale)
        close = compute_close_up_layout(map(read, numbers), canvas.size, job["view"], job["camera"] == "fixed")
        draw = partial(draw_close_up, canvas, close)
    for number in numbers:
        canvas.clear()
        draw(read(number))
        yield canvas.pixels()
