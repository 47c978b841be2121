"""Pictures and films of a run as PNG, GIF, MP4 or HTML files, without a screen."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial, reduce
from operator import or_
from pathlib import Path
from typing import Any

from thirdbody.atomic_files import write_output
from thirdbody.errors import InputError, nearest
from thirdbody.plot.figures import writable
from thirdbody.render.elsewhere import draw_elsewhere
from thirdbody.render.film import DRAWN, FilmReporter, film_reporter, frame_numbers, gif, mp4, pyav
from thirdbody.render.picture_data import read_close_up, read_picture_data, refuse_lost
from thirdbody.render.surfaces import draw_plate_map
from thirdbody.render.web_viewer import write_page
from thirdbody.trajectory.run_file import RunFile

STILLS, FILMS, PAGES = (".png",), (".gif", ".mp4"), (".html",)
CAMERAS, VIEWS = ("fixed", "follow"), ("iso", "side", "front", "top")
FASTEST = 60
SIDES = (200, 8192)  # smallest and largest width and height of a picture [pixels]
CLOSEST = 1e-4  # smallest `zoom`: of a domain of a hundred million bodies it shows one


@dataclass(frozen=True)
class PictureOptions:
    """Options of a picture, film or page.

    `frame` is its number [the last]; `color` is `state`, `reason`, `speed`, or any array of the bodies, spheres or contacts (of
    these the largest of a body), vectors by length; `size` is (width, height) in pixels. `zoom` (0.0001 to 1) is the fraction of
    the domain's width and depth that is shown; `view` is iso, side, front or top; `forces` draws contact forces as tubes; `body`
    shows one body close up, by its id. Of a film: `frames` is a:b:c [all], `fps` the number of frames per second, `camera` of a
    close-up is `fixed` or moves with the body (`follow`) [follow]. A page has these frames too and plays at that rate; `frame` is
    then the only one. `plate` (lower or upper) draws the map of a measure on that
    plate, `color` is its name; with `cycles` that of so many cycles, by the rate of the run's.
    """

    frame: int | None = None
    color: str = "state"
    size: tuple[int, int] = (1600, 900)
    zoom: float | None = None
    view: str = "iso"
    forces: bool = False
    body: int | None = None
    frames: str | None = None
    fps: int = 12
    camera: str | None = None
    plate: str | None = None
    cycles: float | None = None


def render(run_path: str | Path, output: str | Path, *, progress: bool | FilmReporter = False, **options: Any) -> Path:
    """Draw one frame of a run (the last) into a .png file, or many into a .gif, .mp4 or .html; return its path.

    An .html file is a page for a browser with a slider over the frames, of many over evenly spaced ones. Options are the fields
    of `PictureOptions`: frame, color, size, zoom, view, forces, body, frames, fps, camera, plate, cycles.
    `progress` of a film: True draws a bar on a terminal; a callable gets the number of pictures drawn and their total. Raises
    InputError for an invalid run, frame, array or option, MissingLibrary when the system cannot draw, OutputError when the file
    cannot be written.
    """
    output, chosen = checked_output(output), PictureOptions(**options)
    film, page = output.suffix.lower() in FILMS, output.suffix.lower() in PAGES
    _check_options(output.suffix.lower(), chosen)
    with RunFile(run_path) as run:
        if chosen.plate is not None:
            return draw_plate_map(run, output, chosen)
        last = -1 if chosen.frame is None else chosen.frame
        several = film or (page and chosen.frame is None and run.frames)
        numbers = frame_numbers(chosen.frames, run.frames) if several else [run.frame_number(last)]
        for number in numbers[:-1]:
            refuse_lost(run, number, run.bodies(number), run.spheres(number))
        # errors of a picture are raised here, not by the process that draws
        data = read_picture_data(run, numbers[-1], chosen.color, chosen.forces)
        if not len(data.radii):
            raise InputError(f"{run.path}: this run has no bodies to draw")
        if chosen.body is not None:
            read_close_up(run, numbers[-1], chosen.body, chosen.color)
        if page:
            return write_page(run, numbers, output, chosen.color, chosen.view, chosen.fps)
    job = asdict(chosen) | {"run": str(run.path), "file": str(output), "frames": numbers}
    with film_reporter(film and progress, output.name) as report:
        draw_elsewhere(__name__, job, report)
    return output


def _check_options(suffix: str, o: PictureOptions) -> None:
    film, page, (wide, tall) = suffix in FILMS, suffix in PAGES, o.size
    wrong = [
        (o.zoom is not None and not CLOSEST <= o.zoom <= 1.0, f"zoom: {o.zoom} is outside {CLOSEST:g} to 1, the fraction of "
         "the domain that is shown"),
        (not SIDES[0] <= min(o.size) <= max(o.size) <= SIDES[1],
         f"size: {wide} x {tall} is outside {SIDES[0]} to {SIDES[1]} pixels each"),
        (suffix == ".mp4" and any(side % 2 for side in o.size), f"size: {wide} x {tall}: MP4 needs even numbers of pixels"),
        (o.view not in VIEWS, f"view: no view '{o.view}'; {nearest(o.view, VIEWS)}"),
        (o.camera not in (None, *CAMERAS), f"camera: '{o.camera}' is neither fixed nor follow"),
        (o.camera == "follow" and o.body is None, "camera: follow needs the body to follow; give its id as body"),
        (not 1 <= o.fps <= FASTEST, f"fps: {o.fps} is outside 1 to {FASTEST}"),
        (film and o.frame is not None, f"frame: a film ({suffix}) takes frames a:b:c"),
        (not (film or page) and o.frames is not None, f"frames: {suffix} shows one frame; give frame, or name a .gif or .mp4"),
        (page and (o.forces or o.body is not None), "forces, body: drawn in .png, .gif, .mp4, not in .html"),
        (page and None not in (o.frame, o.frames), "frame, frames: give one of them, or none for all frames"),
        (page and o.zoom is not None, "zoom: for pictures and films; a page zooms with the wheel"),
        (o.plate is not None and (suffix not in STILLS or o.body is not None or o.forces or o.zoom is not None),
         "plate: the map of a plate is a .png, without body, forces and zoom"),
        (o.cycles is not None and (o.plate is None or not 0.0 < o.cycles < 1e12), "cycles: a number above 0, with plate"),
        (o.body is not None and (o.forces or o.zoom is not None), "body: a close-up has its own forces; leave out forces, zoom"),
    ]  # fmt: skip
    for is_wrong, words in wrong:
        if is_wrong:
            raise InputError(words)
    if suffix == ".mp4":
        pyav()


def checked_output(path: str | Path, allowed: tuple[str, ...] = STILLS + FILMS + PAGES) -> Path:
    """Return the path of a picture to write. Raises InputError for another suffix, OutputError without its folder."""
    path = Path(path)
    if path.suffix.lower() not in allowed:
        names = " or ".join([", ".join(allowed[:-1]), allowed[-1]] if allowed[1:] else allowed)
        raise InputError(f"{path}: pictures are written by their suffix; name it {names}")
    return writable(path)


def draw(job: dict[str, Any]) -> None:
    """Draw the frames of a job, as `render` checked it, in the second process. Raises OutputError."""
    from thirdbody.render.canvas import Canvas, save_png

    file = Path(job["file"])
    with RunFile(job["run"]) as run, Canvas(tuple(job["size"])) as canvas:
        pictures = _draw_pictures(run, job, canvas)
        if file.suffix.lower() == ".png":
            save_png(next(pictures), file, origin(run, job))
        else:
            write_output(file, {".gif": gif, ".mp4": mp4}[file.suffix.lower()](pictures, job["fps"]))


def origin(run: Any, job: dict[str, Any]) -> dict[str, str]:
    """Return the origin of a still for its PNG text chunks: title, frame, time, options, the resolved scene as TOML."""
    number = job["frames"][-1]
    return {
        "Software": "thirdbody",
        "Title": str(run.header.get("title", "")),
        "frame": f"{number} of 0 to {run.frames - 1}",
        "time": f"{float(run.times[number])!r} s",
        "options": json.dumps({name: job[name] for name in ("color", "size", "zoom", "view", "forces", "body")}),
        "scene": run.scene_text,
    }


def _draw_pictures(run: Any, job: dict[str, Any], canvas: Any) -> Iterator[Any]:
    # all in one layout: only what moves in the run moves in the film
    from thirdbody.render.closeup import compute_close_up_layout, draw_close_up
    from thirdbody.render.layout import compute_layout, draw_picture

    numbers, color = job["frames"], job["color"]
    scale = reduce(or_, (read_picture_data(run, number, color).legend for number in numbers))
    if job["body"] is None:
        read: Callable[[int], Any] = partial(read_picture_data, run, color=color, forces=job["forces"], scale=scale)
        layout = compute_layout(map(read, numbers), job["view"], job["zoom"])
        draw_one: Callable[[Any], None] = partial(draw_picture, canvas, layout)
    else:
        read = partial(read_close_up, run, body=job["body"], color=color, scale=scale)
        close = compute_close_up_layout(map(read, numbers), job["view"], job["camera"] == "fixed")
        draw_one = partial(draw_close_up, canvas, close)
    for count, number in enumerate(numbers, start=1):
        canvas.clear()
        draw_one(read(number))
        yield canvas.pixels()
        print(f"{DRAWN}{count}", flush=True)
