"""Drawing in a second process: without its system libraries VTK crashes instead of raising an error.

So these are checked first, and a crash of the second process becomes one sentence.
"""

import ctypes
import pickle
import subprocess
import sys
import tempfile
import threading
import time
from importlib import import_module
from importlib.util import find_spec

from thirdbody.errors import MissingLibrary, OutputError, ThirdbodyError
from thirdbody.render.film import DRAWN, FilmReporter
from thirdbody.system.processes import python_command, python_environment

EGL, OSMESA = "vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"
LIBRARIES = {EGL: ("libEGL.so.1",), OSMESA: ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")}
ADVICE = "install libegl1 and libgl1-mesa-dri, or libosmesa6 (apt-get install libegl1 libgl1-mesa-dri)"

# Time limits of the first and each further drawing [s]: one of 100 000 spheres takes below a minute on a slow core.
PATIENCE, PATIENCE_PER_FRAME = 600.0, 60.0


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


def draw_elsewhere(module: str, job: dict, report: FilmReporter | None = None) -> None:
    """Call `draw(job)` of a module in a second process, with the first kind of window that does not crash.

    `job` can be pickled; its `file` is the picture, `report` is called for each of its `frames`. Raises OutputError when the file
    cannot be written, MissingLibrary without pyvista or when every window crashes.
    """
    windows = usable_windows()
    if find_spec("pyvista") is None:
        raise MissingLibrary("pictures are drawn with pyvista, which is not installed: pip install pyvista")
    crash = ""
    for kind in windows:
        code, errors = _start(module, job, kind, report)
        if code == 0:
            return
        if code == OutputError.exit_code:
            raise OutputError((errors.strip().splitlines() or [""])[-1])
        if code == 1 and "Traceback" in errors:
            raise RuntimeError(f"drawing failed:\n{errors}")
        crash = f"{kind or 'VTK'} ended with code {code}"
    raise MissingLibrary(f"VTK cannot draw without a screen here ({crash}): {ADVICE}")


def _start(module: str, job: dict, kind: str | None, report: FilmReporter | None = None) -> tuple[int, str]:
    # the exit code of the second process, and what it wrote to standard error
    environment = python_environment()
    environment["ALLOW_PLOTTING"] = "true"  # otherwise pyvista tests this by opening a window
    if kind is not None:
        environment["VTK_DEFAULT_OPENGL_WINDOW"] = kind
    total = len(job.get("frames", ()))
    limit = PATIENCE + PATIENCE_PER_FRAME * total
    command = python_command("thirdbody.render.elsewhere", module)
    # job and errors are files: several pipes would have to be written and read at once
    with tempfile.TemporaryFile() as source, tempfile.TemporaryFile("w+") as errors:
        pickle.dump(job, source)
        source.seek(0)
        with subprocess.Popen(
            command, env=environment, stdin=source, stdout=subprocess.PIPE, stderr=errors, text=True
        ) as process:  # fmt: skip
            began, timer = time.monotonic(), threading.Timer(limit, process.kill)
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
        if process.returncode and time.monotonic() - began > limit:
            raise MissingLibrary(f"VTK drew nothing within {limit:.0f} s: {ADVICE}")
        errors.seek(0)
        return process.returncode, errors.read()


def main(module: str) -> int:
    """Draw the job that `draw_elsewhere` passes on standard input; return the exit code."""
    job = pickle.load(sys.stdin.buffer)
    try:
        import_module(module).draw(job)
    except ThirdbodyError as error:
        print(error, file=sys.stderr)
        return OutputError.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
