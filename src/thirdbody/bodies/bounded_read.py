"""Bounded reading of the user's files, and the range of valid lengths."""

from pathlib import Path

from thirdbody.errors import Fault, InputError

SMALLEST, LARGEST = 1e-30, 1e30
"""Range of lengths [m] whose 5th and 10th powers are normal numbers: others come from wrong units only."""


MAX_BYTES = 500_000_000
"""Bytes of the largest file: ten million triangles. A larger one is refused before it is read."""


MAX_ROWS = 1_000_000
"""Most spheres in one table of bodies: a minute and 3 GB for as many bodies, three times the memory for text."""


def read_bytes(path: Path, key: str = "") -> bytes:
    """Return the bytes of a file. InputError: one fault with the path, if it is missing, no file, too large, or not readable."""
    file = str(path) if len(str(path)) < 200 else f"{str(path)[:200]}..."
    try:
        if path.is_file():
            if (size := path.stat().st_size) > MAX_BYTES:
                message = f"has {size / 1e6:.0f} MB, at most {MAX_BYTES / 1e6:.0f} MB are read"
                raise InputError(Fault(key, message, file))
            return path.read_bytes()
        folder, there = path.is_dir(), path.exists()
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(Fault(key, f"cannot be read: {why}", file)) from None
    if folder or there:
        raise InputError(Fault(key, f"is {'a folder' if folder else 'a device'}, expected a file", file))
    message = "there is no such file; give the path from the folder of the scene, or an absolute one"
    raise InputError(Fault(key, message, file))
