"""Films: VP9 in MP4 or WebM, written by PyAV (BSD-3) with libvpx (BSD-3); the extra ``video``.

PyAV's wheels bring FFmpeg under the LGPL and, beside it, x264 and x265 under the GPL, of which nothing is used here.
"""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.extras import how_to_install

SUFFIXES = (".mp4", ".webm")
CODEC = "libvpx-vp9"
OPTIONS = {"deadline": "realtime", "cpu-used": "7", "crf": "32", "b": "0"}
"""Constant quality: half a megabyte for 30 s of three views, written faster than it plays."""


class FilmError(RuntimeError):
    """The film could not be written; the message says why."""


def write_film(path: Path, frames: Iterable[np.ndarray], rate_hz: float) -> int:
    """Write a film.

    Args:
        path: ends in .mp4 or .webm; a file that is there is replaced, and only by a whole one.
        frames: images of one size with even width and height, shape (height, width, 3), uint8, red first.
        rate_hz: frames a second.

    Returns:
        How many frames it has.

    Raises:
        ValueError: another suffix.
        FilmError: PyAV is not installed, no frame came, or the encoder refused.
    """
    if path.suffix not in SUFFIXES:
        raise ValueError(f"a film is {path.suffix or 'without a suffix'}; choose from {' and '.join(SUFFIXES)}")
    av, count = _pyav(), 0
    unfinished = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        with av.open(str(unfinished), "w") as container:
            stream = container.add_stream(CODEC, rate=Fraction(rate_hz).limit_denominator(1000), options=OPTIONS)
            stream.pix_fmt = "yuv420p"
            for frame in frames:
                if not count:
                    stream.height, stream.width = frame.shape[:2]
                container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
                count += 1
            if not count:
                raise FilmError("there is no frame to write")
            container.mux(stream.encode())
        unfinished.replace(path)
    except av.error.FFmpegError as error:
        raise FilmError(f"the film could not be written: {error}") from error
    finally:
        unfinished.unlink(missing_ok=True)
    return count


def _pyav() -> Any:
    try:
        import av
    except ImportError as error:
        raise FilmError(f"films need PyAV ({error}): {how_to_install('vision', 'video')}") from error
    return av
