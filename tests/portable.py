"""What tests share so that they depend neither on the clock and the load, nor on versions of libraries."""

import os
from pathlib import Path

import numpy as np
from PIL import Image

# seconds on the clock after which another process hangs: cold starts compile for half a minute, on shared cores for minutes
PATIENCE = 600.0


def drawn(picture: Path) -> float:
    """Share of the pixels of a picture that differ from that in the corner: the size of a file tells of the compression too."""
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB"))
    return float(np.mean((pixels != pixels[0, 0]).any(axis=2)))


def processor_seconds(process: int) -> float:
    """Processor seconds of a running process, its threads and the children that it has waited for; from Linux' /proc."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
