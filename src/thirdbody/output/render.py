"""Pictures of a run as PNG files, without a screen.

Without the system libraries that it needs VTK does not raise an error: it crashes. So they are looked for
first, and the drawing is done by a second process, whose crash becomes one sentence.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
from pathlib import Path

from thirdbody.errors import InputError, MissingLibrary, OutputError

EGL, OSMESA = "vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"
LIBRARIES = {EGL: ("libEGL.so.1",), OSMESA: ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")}
ADVICE = "install libegl1 and libgl1-mesa-dri, or libosmesa6 (apt-get install libegl1 libgl1-mesa-dri)"

# A drawing of 100 000 spheres on one slow core takes below a minute.
PATIENCE = 600.0


def render(
    run_path: str | Path,
    output_png: str | Path,
    frame: int = -1,
    color: str = "state",
    size: tuple[int, int] = (1600, 900),
    zoom: float | None = None,
) -> Path:
    """Draw one frame of a run into a PNG file; returns its path.

    `color` is `state`, `speed`, or any array of the bodies, spheres or contacts (of these the largest of a
    body); vectors count by length. `zoom` (0 to 1) is the share of the domain's width and depth that is
    shown. Raises InputError for a run, frame, array or option that is not there, MissingLibrary when the
    system cannot draw, OutputError when the file cannot be written.
    """
    from thirdbody.output.run import open_run
    from thirdbody.output.shot import take_shot

    output_png = checked_png(output_png)
    if zoom is not None and not 0.0 < zoom <= 1.0:
        raise InputError(f"zoom: {zoom:g} is outside 0 to 1, the share of the domain that is shown")
    if min(size) < 200:
        raise InputError(f"size: {size[0]} x {size[1]} is too small, 200 pixels are the least")
    with open_run(run_path) as run:
        try:
            take_shot(run, frame, color)
        except IndexError as error:
            raise InputError(str(error)) from error
        run_file = run.path
    job = {
        "run": str(run_file),
        "png": str(output_png),
        "frame": frame,
        "color": color,
        "size": size,
        "zoom": zoom,
    }
    draw_elsewhere(job, usable_windows())
    return output_png


def checked_png(path: str | Path) -> Path:
    """The path of a picture to write. Raises InputError for another suffix, OutputError without its folder."""
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: pictures are written as PNG only in this version; name it .png")
    if not path.absolute().parent.is_dir():
        raise OutputError(f"{path}: the folder {path.parent} does not exist")
    return path


def usable_windows() -> list[str | None]:
    """The kinds of off-screen window to try, best first; None leaves the choice to VTK (not on Linux).

    Raises MissingLibrary when there is none.
    """
    if not sys.platform.startswith("linux"):
        return [None]
    found: list[str | None] = [kind for kind, names in LIBRARIES.items() if any(map(_loads, names))]
    if not found:
        raise MissingLibrary(f"no library to draw without a screen: {ADVICE}")
    return found


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def draw_elsewhere(job: dict, windows: list[str | None]) -> None:
    """Let a second process draw, with the first kind of window that does not crash.

    Raises OutputError when the file cannot be written, MissingLibrary when every window crashes.
    """
    crash = ""
    for kind in windows:
        done = _start(job, kind)
        if done.returncode == 0:
            return
        last = (done.stderr.strip().splitlines() or [""])[-1]
        if done.returncode == OutputError.exit_code:
            raise OutputError(last)
        if done.returncode == 1 and "Traceback" in done.stderr:
            raise RuntimeError(f"drawing failed:\n{done.stderr}")
        crash = f"{kind or 'VTK'} ended with code {done.returncode}"
    raise MissingLibrary(f"VTK cannot draw without a screen here ({crash}): {ADVICE}")


def _start(job: dict, kind: str | None) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    if kind is not None:
        environment["VTK_DEFAULT_OPENGL_WINDOW"] = kind
    command = [sys.executable, "-m", "thirdbody.output.render", json.dumps(job)]
    try:
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired as error:
        raise MissingLibrary(f"VTK drew nothing within {PATIENCE:.0f} s: {ADVICE}") from error


def main(argument: str) -> int:
    """The second process: draw the job that `render` or `gallery` wrote as JSON; returns the exit code."""
    job = json.loads(argument)
    try:
        if "gallery" in job:
            from thirdbody.output import gallery

            gallery.draw(Path(job["gallery"]), Path(job["png"]))
        else:
            _draw_run(job)
    except OSError as error:
        print(f"{job['png']}: cannot be written ({error.strerror})", file=sys.stderr)
        return OutputError.exit_code
    return 0


def _draw_run(job: dict) -> None:
    from thirdbody.output.picture import draw
    from thirdbody.output.run import open_run
    from thirdbody.output.shot import take_shot

    with open_run(job["run"]) as run:
        shot = take_shot(run, job["frame"], job["color"])
    draw(shot, Path(job["png"]), tuple(job["size"]), job["zoom"])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
