"""Shell completion: scripts by typer; here the cases that it leaves open: unknown shells, missing rights, and zsh."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from thirdbody.errors import OutputError, UsageError

SHELLS = ("bash", "zsh", "fish", "powershell", "pwsh")
ZSH_FUNCTION = ".zfunc/_thirdbody"
COMPLETE_NOW = '[[ $zsh_eval_context[-1] == loadautofunc ]] && _thirdbody_completion "$@"\n'


@contextmanager
def checked_completion() -> Iterator[None]:
    """Let typer show or install completion. Raises UsageError in an unknown shell, OutputError when writing fails."""
    shell = _current_shell()
    if shell not in SHELLS:
        raise UsageError(f"completion exists for bash, zsh and fish; the shell here is {shell}: start one of them and repeat")
    try:
        yield
    except OSError as error:
        raise OutputError(f"{error.filename}: cannot be written ({error.strerror})") from error
    except RuntimeError as error:  # raised by pathlib
        if _home() is None:
            raise OutputError("completion is installed in the home folder, and this user has none: set HOME") from error
        raise
    finally:
        home = _home()
        if shell == "zsh" and home is not None:
            _complete_at_first_tab(home / ZSH_FUNCTION)


def _home() -> Path | None:
    """Return the home folder, None without one: HOME is not set and the system does not know the user."""
    try:
        return Path.home()
    except RuntimeError:
        return None


def _current_shell() -> str:
    """Return the name of the shell that started this process, or "unknown"."""
    from shellingham import ShellDetectionFailure, detect_shell

    try:
        return detect_shell()[0]
    except ShellDetectionFailure:
        return "unknown"


def _complete_at_first_tab(path: Path) -> None:
    """Make zsh complete at the first tab of a session; otherwise that tab only loads typer's function."""
    with suppress(OSError):  # completion is shown only, or the error message follows
        text = path.read_text()
        if "_thirdbody_completion" in text and "loadautofunc" not in text:
            path.write_text(f"{text}\n{COMPLETE_NOW}")
