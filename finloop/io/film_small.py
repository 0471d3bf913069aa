"""A film of few bytes, for a page that embeds it."""

from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.io.movie import Mp4Writer
from finloop.io.video import read_frames

_CRF = 28  # coding quality of a film made smaller
_WIDTHS = (960, 640, 426)


def small_film(path: Path, most_bytes: int) -> tuple[bytes, Picture]:
    """Return an MP4 file's bytes, coded again with a smaller width if needed, and its first frame.

    most_bytes: upper limit of the bytes. The first frame (h, w, 3), RGB uint8, has its full size.
    FinloopError if the film cannot be read, or is too long to become so small.
    """
    poster = next(iter(read_frames(path, colour=True)))
    film = path.read_bytes()
    for width in _WIDTHS:
        if len(film) > most_bytes:
            film = _narrower(path, poster.shape, width)
    if len(film) > most_bytes:
        raise FinloopError(
            f"{path} has {len(film) / 1e6:.1f} MB even at a width of {_WIDTHS[-1]} px",
            f"a film of at most {most_bytes / 1e6:.1f} MB",
            "raise report.max_film_mb, or lower animate.seconds",
        )
    return film, poster


def _narrower(path: Path, shape: tuple[int, ...], width: int) -> bytes:
    wide = min(width, shape[1])
    size = wide, max(2, round(shape[0] * wide / shape[1]))
    with av.open(str(path)) as container:
        rate = Fraction(container.streams.video[0].average_rate or 25)
    with TemporaryDirectory() as folder:
        small = Path(folder) / "film.mp4"
        with Mp4Writer(small, (size[1], size[0], 3), rate, _CRF) as writer:
            for frame in read_frames(path, colour=True):
                writer.write(cv2.resize(frame, size, interpolation=cv2.INTER_AREA))
        return small.read_bytes()
