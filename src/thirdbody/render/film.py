"""Films of a run as GIF or MP4: selection of frames, encoding of the pictures that `layout` draws, and progress."""

import io
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from thirdbody.errors import InputError, MissingLibrary
from thirdbody.system.terminal import progress_bar

# Quality of H.264: below 20 no loss is visible.
QUALITY = "18"

# Colours of a GIF's palette; sampling step of pixels for it; level above which a colour becomes white (edges of text).
GIF_COLORS, SAMPLED, ALMOST_WHITE = 256, 3, 247
# Range of red, green and blue from which a pixel counts as coloured.
COLORFUL = 40

FilmReporter = Callable[[int, int], None]  # called with the number of pictures drawn and their total
DRAWN = "thirdbody drew picture "  # prefix of the line that the drawing process prints for each picture, before its number


@contextmanager
def film_reporter(progress: bool | FilmReporter, title: str) -> Iterator[FilmReporter | None]:
    """Yield the reporter for `progress` of a film: a callable itself; True: a bar on standard error, where it is a terminal."""
    if progress is not True or not sys.stderr.isatty():
        yield None if isinstance(progress, bool) else progress
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

    with progress_bar(title, None, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as update:
        yield lambda done, total: update(completed=done, total=total)


def frame_numbers(text: str | None, count: int) -> list[int]:
    """Return the frames of `a:b:c`, as a Python slice: from a, before b, every c-th; all of `count` without text.

    Raises InputError for anything else, or when no frame is left.
    """
    text = (text or "").strip() or ":"
    parts = text.split(":")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
        if not 2 <= len(parts) <= 3:
            raise ValueError
        chosen = range(count)[slice(*numbers)]
    except ValueError as error:
        raise InputError(f"frames: '{text}' is not a:b or a:b:c (from a, before b, every c-th), such as 0:100:2") from error
    if not len(chosen):
        raise InputError(f"frames: '{text}' leaves none of the {count} frames of this run")
    return list(chosen)


def pyav() -> Any:
    """Return the module that encodes MP4. Raises MissingLibrary without it."""
    try:
        import av
    except ImportError as error:
        raise MissingLibrary(f'MP4 needs PyAV ({error}): pip install "thirdbody[film]", or name a .gif') from error
    return av


def mp4(pictures: Iterator[np.ndarray], fps: int) -> bytes:
    """Return an MP4 file (H.264, plays everywhere) of pictures (height, width, 3) uint8 with even sides."""
    av, file = pyav(), io.BytesIO()
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=fps, options={"crf": QUALITY, "preset": "veryfast"})
        stream.pix_fmt = "yuv420p"
        for number, picture in enumerate(pictures):
            if not number:
                stream.height, stream.width = picture.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")))
        container.mux(stream.encode(None))
    return file.getvalue()


def gif(pictures: Iterator[np.ndarray], fps: int) -> bytes:
    """Return a GIF file, in one palette for all pictures (height, width, 3) uint8, against flicker."""
    from PIL import Image

    # The palette needs all pictures: until then they are stored compressed to about a tenth.
    shape, compressed, samples = (0, 0, 3), [], []
    for picture in pictures:
        shape = picture.shape
        compressed.append(zlib.compress(picture.tobytes(), 1))
        samples.append(picture[::SAMPLED, ::SAMPLED])
    # the best palette for at most a dozen of the samples, including white
    pixels = np.concatenate([sample.reshape(-1, 3) for sample in samples[:: -(-len(samples) // 12)]])
    # Coloured pixels get a higher weight, or small bodies of a rare state would get no shades among so much paper.
    bright = pixels[np.ptp(pixels.astype(np.int16), axis=1) > COLORFUL]
    weighed = np.concatenate([pixels[::8], bright, bright])[None]
    palette = Image.fromarray(weighed).quantize(colors=GIF_COLORS, method=Image.Quantize.MEDIANCUT)
    colors = np.array(palette.getpalette(), np.uint8).reshape(-1, 3)
    colors[np.all(colors >= ALMOST_WHITE, axis=1)] = 255
    palette.putpalette(colors.ravel().tolist())
    frames = []
    for packed in compressed:
        picture = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(shape)
        frames.append(Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE))
    file = io.BytesIO()
    # GIF delays are in hundredths of a second; below two of them many programs use ten.
    pause = 10 * max(2, round(100 / fps))
    frames[0].save(file, "GIF", save_all=True, append_images=frames[1:], duration=pause, loop=0, optimize=False)
    return file.getvalue()
