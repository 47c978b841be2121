"""Files of figures: formats, and writing them whole and the same for equal figures."""

import io
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from thirdbody.atomic_files import write_output
from thirdbody.errors import OutputError, UsageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".png", ".pdf", ".svg")
DOTS = 180  # per inch: nearly 300 where the picture is printed in one column of two (3.4 inch)


def check_format(path: Path) -> None:
    """Raise UsageError for a picture whose suffix is not in FORMATS."""
    if path.suffix.lower() not in FORMATS:
        raise UsageError(f"{path}: a picture ends in {', '.join(FORMATS)}")


def checked_path(path: str | Path) -> Path:
    """Return the path of a picture to write. Raises UsageError for another suffix, OutputError without its folder."""
    path = Path(path)
    check_format(path)
    return writable(path)


def writable(path: Path) -> Path:
    """Return the path of a file to write. Raises OutputError without its folder."""
    if not os.path.isdir(path.absolute().parent):
        raise OutputError(f"{path}: cannot be written (the folder {path.parent} does not exist)")
    try:
        path.stat()
    except FileNotFoundError:
        pass
    except OSError as problem:  # a name too long: told before anything is computed for it
        raise OutputError(f"{path}: cannot be written ({problem.strerror or problem})") from problem
    return path


def save(figure: "Figure", path: Path, dots: int = DOTS) -> None:
    """Write a figure whole or not at all, equal pictures as equal files. Raises OutputError when it cannot be written."""
    from matplotlib import rc_context

    kind, content = path.suffix.lower()[1:], io.BytesIO()
    # dates and random names of shapes would make equal pictures differ; letters stay letters in PDF
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with rc_context({"svg.hashsalt": "thirdbody", "pdf.fonttype": 42}), _one_warning_of_letters(path):
        figure.savefig(content, format=kind, dpi=dots, metadata=metadata)
    write_output(path, content.getvalue())


@contextmanager
def _one_warning_of_letters(path: Path) -> Iterator[None]:
    """Replace the warnings of matplotlib, one for each letter missing in its font, by a single one."""
    with warnings.catch_warnings(record=True) as caught:
        yield
    lacking = [entry for entry in caught if "missing from font" in str(entry.message)]
    for entry in caught:
        if entry not in lacking:
            warnings.warn_explicit(entry.message, entry.category, entry.filename, entry.lineno)
    if lacking:
        warnings.warn(f"{path}: the font has no sign for some letters, which are drawn as boxes", stacklevel=3)
