"""Pictures and films of a run as PNG, GIF, MP4 or HTML files, without a screen.

Without its system libraries VTK crashes instead of raising an error. So these are checked first, and a second process does the
drawing, whose crash becomes one sentence. Pages are drawn by a browser and need no such libraries.
"""

import ctypes
import json
import os
import subprocess
import sys
import tempfile
import threading
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from thirdbody.errors import InputError, MissingLibrary, OutputError, ThirdbodyError, nearest
from thirdbody.render.film_progress import DRAWN, FilmReporter, film_reporter
from thirdbody.system.child_process import python_command, python_environment

EGL, OSMESA = "vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"
LIBRARIES = {EGL: ("libEGL.so.1",), OSMESA: ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")}
ADVICE = "install libegl1 and libgl1-mesa-dri, or libosmesa6 (apt-get install libegl1 libgl1-mesa-dri)"

# Time limits of the first and each further drawing [s]: one of 100 000 spheres takes below a minute on a slow core.
PATIENCE, PATIENCE_PER_FRAME = 600.0, 60.0

STILLS, FILMS, PAGES = (".png",), (".gif", ".mp4"), (".html",)
CAMERAS = ("fixed", "follow")
FASTEST = 60
SIDES = (200, 8192)
"""Smallest and largest width and height of a picture [pixels]."""
CLOSEST = 1e-4
"""Smallest `zoom`: of a domain of a hundred million bodies it shows one."""


@dataclass(frozen=True)
class PictureOptions:
    """Options of a picture, film or page.

    `frame` is its number [the last]; `color` is `state`, `reason`, `speed`, or any array of the bodies, spheres or contacts (of
    these the largest of a body), vectors by length; `size` is (width, height) in pixels. `zoom` (0.0001 to 1) is the fraction of
    the domain's width and depth that is shown; `view` is iso, side, front or top; `forces` draws contact forces as tubes; `body`
    shows one body close up, by its id. Of a film: `frames` is a:b:c [all], `fps` the number of frames per second, `camera` of a
    close-up is `fixed` or moves with the body (`follow`) [follow]. `plate` (lower or upper) draws the map of a measure on that
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
    """Draw one frame of a run (the last) into a .png or .html file, or many into a .gif or .mp4; return its path.

    Options are the fields of `PictureOptions`: frame, color, size, zoom, view, forces, body, frames, fps, camera, plate, cycles.
    `progress` of a film: True draws a bar on a terminal; a callable gets the number of pictures drawn and their total. Raises
    InputError for an invalid run, frame, array or option, MissingLibrary when the system cannot draw, OutputError when the file
    cannot be written.
    """
    from thirdbody.render.picture_data import refuse_lost
    from thirdbody.trajectory.reader import open_run

    output, chosen = checked_output(output), PictureOptions(**options)
    _check_options(output, chosen)
    with open_run(run_path) as run:
        if chosen.plate is not None:
            from thirdbody.render.plate_map import draw_plate_map

            return draw_plate_map(run, output, chosen.plate, asdict(chosen))
        numbers = _frame_numbers(run, output, chosen)
        for number in numbers[:-1]:
            refuse_lost(run, number, run.bodies(number), run.spheres(number))
        data = _read_one(run, numbers[-1], chosen)
        run_file = run.path
    if output.suffix.lower() in PAGES:
        from thirdbody.render.web_viewer import write_page

        try:
            write_page(data, output, chosen.view)
        except OSError as error:
            raise OutputError(f"{output}: cannot be written ({error.strerror})") from error
        return output
    job = asdict(chosen) | {"run": str(run_file), "file": str(output), "frames": numbers}
    with film_reporter(progress if output.suffix.lower() in FILMS else False, output.name) as report:
        draw_elsewhere(job, usable_windows(), report)
    return output


def _check_options(output: Path, options: PictureOptions) -> None:
    """Raise InputError for invalid or incompatible options."""
    from thirdbody.render.picture_data import VIEWS

    suffix, o = output.suffix.lower(), options
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
        (not film and o.frames is not None, f"frames: {suffix} shows one frame; give frame, or name a .gif or .mp4"),
        (page and (o.forces or o.body is not None), "forces, body: drawn in .png, .gif, .mp4, not in .html"),
        (page and o.zoom is not None, "zoom: for pictures and films; a page zooms with the wheel"),
        (o.plate is not None and (suffix not in STILLS or o.body is not None or o.forces or o.zoom is not None),
         "plate: the map of a plate is a .png, without body, forces and zoom"),
        (o.cycles is not None and (o.plate is None or not 0.0 < o.cycles < 1e12), "cycles: a number above 0, with plate"),
        (o.body is not None and (o.forces or o.zoom is not None), "body: a close-up has its own forces; leave out forces, zoom"),
    ]  # fmt: skip
    for is_wrong, words in wrong:
        if is_wrong:
            raise InputError(words)


def _frame_numbers(run: Any, output: Path, options: PictureOptions) -> list[int]:
    """Return the frames to draw. Raises InputError when they are not in the run."""
    from thirdbody.render.film import frame_numbers

    if output.suffix.lower() in FILMS:
        return frame_numbers(options.frames, run.frames)
    try:
        return [run.frame_number(-1 if options.frame is None else options.frame)]
    except IndexError as error:
        raise InputError(str(error)) from error


def _read_one(run: Any, number: int, options: PictureOptions) -> Any:
    """Read the data of one frame: errors of a picture are raised here, not by the process that draws."""
    from thirdbody.render.picture_data import read_picture_data

    data = read_picture_data(run, number, options.color, options.forces)
    if not len(data.radii):
        raise InputError(f"{run.path}: this run has no bodies to draw")
    if options.body is not None:
        from thirdbody.render.closeup_data import read_close_up

        read_close_up(run, number, options.body, options.color)
    return data


def checked_output(path: str | Path, allowed: tuple[str, ...] = STILLS + FILMS + PAGES) -> Path:
    """Return the path of a picture to write. Raises InputError for another suffix, OutputError without its folder."""
    path = Path(path)
    if path.suffix.lower() not in allowed:
        names = " or ".join([", ".join(allowed[:-1]), allowed[-1]] if allowed[1:] else allowed)
        raise InputError(f"{path}: pictures are written by their suffix; name it {names}")
    if not os.path.isdir(path.absolute().parent):
        raise OutputError(f"{path}: the folder {path.parent} does not exist")
    return path


def usable_windows() -> list[str | None]:
    """Return the kinds of off-screen window to try, best first; None leaves the choice to VTK (not on Linux).

    Raises MissingLibrary when there is none.
    """
    if not sys.platform.startswith("linux"):
        return [None]
    usable: list[str | None] = [kind for kind, names in LIBRARIES.items() if any(map(_loads, names))]
    if not usable:
        raise MissingLibrary(f"no library to draw without a screen: {ADVICE}")
    return usable


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def draw_elsewhere(job: dict, windows: list[str | None], report: FilmReporter | None = None) -> None:
    """Draw in a second process, with the first kind of window that does not crash.

    `report` is called for each picture of a film. Raises OutputError when the file cannot be written, MissingLibrary without
    pyvista or when every window crashes.
    """
    if find_spec("pyvista") is None:
        raise MissingLibrary("pictures are drawn with pyvista, which is not installed: pip install pyvista")
    crash = ""
    for kind in windows:
        done = _start(job, kind, report)
        if done.returncode == 0:
            return
        last = (done.stderr.strip().splitlines() or [""])[-1]
        if done.returncode == OutputError.exit_code:
            raise OutputError(last)
        if done.returncode == 1 and "Traceback" in done.stderr:
            raise RuntimeError(f"drawing failed:\n{done.stderr}")
        crash = f"{kind or 'VTK'} ended with code {done.returncode}"
    raise MissingLibrary(f"VTK cannot draw without a screen here ({crash}): {ADVICE}")


def _start(job: dict, kind: str | None, report: FilmReporter | None = None) -> subprocess.CompletedProcess[str]:
    environment = python_environment()
    environment["ALLOW_PLOTTING"] = "true"  # otherwise pyvista tests this by opening a window
    if kind is not None:
        environment["VTK_DEFAULT_OPENGL_WINDOW"] = kind
    total = len(job.get("frames", ()))
    limit = PATIENCE + PATIENCE_PER_FRAME * total
    command = python_command("thirdbody.render.render", json.dumps(job))
    # errors go into a file: two pipes would have to be read at once
    with tempfile.TemporaryFile("w+") as errors:
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=errors, text=True) as process:
            late = threading.Event()

            def time_out() -> None:
                late.set()
                process.kill()

            timer = threading.Timer(limit, time_out)
            timer.start()
            try:
                assert process.stdout is not None
                for line in process.stdout:
                    if report is not None and line.startswith(DRAWN):
                        report(int(line.removeprefix(DRAWN)), total)
            except BaseException:
                process.kill()
                raise
            finally:
                timer.cancel()
        if late.is_set():
            raise MissingLibrary(f"VTK drew nothing within {limit:.0f} s: {ADVICE}")
        errors.seek(0)
        return subprocess.CompletedProcess(command, process.returncode, "", errors.read())


def main(argument: str) -> int:
    """Draw the job that `render` or `gallery` wrote as JSON, in the second process; return the exit code."""
    job = json.loads(argument)
    try:
        if "gallery" in job:
            from thirdbody.render.gallery_drawing import draw

            draw(Path(job["gallery"]), Path(job["file"]))
        else:
            from thirdbody.render.worker import draw_run

            draw_run(job)
    except OSError as error:
        print(f"{job['file']}: cannot be written ({error.strerror})", file=sys.stderr)
        return OutputError.exit_code
    except ThirdbodyError as error:
        print(error, file=sys.stderr)
        return OutputError.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
