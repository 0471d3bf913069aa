"""Films for people: H.264 in MP4 that every browser plays, and animated WebP; frame by frame.

Frames are (h, w) grey or (h, w, 3) RGB uint8. Nothing is held but what the coders hold; the file
appears under its name when it is whole; the same frames give the same bytes.
"""

from abc import ABC, abstractmethod
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import av
import cv2
import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import (
    ColorPrimaries,
    ColorRange,
    Colorspace,
    ColorTrc,
)
from numpy.typing import NDArray

from finloop.io.atomic import whole_file
from finloop.io.video import THREADS

_SAME = "mbtree=0:rc-lookahead=0:weightp=0"
_KEY_EVERY_S = 2  # a player can jump to every two seconds
_COLOURS = {
    Colorspace.ITU709: (ColorPrimaries.BT709, ColorTrc.BT709),
    Colorspace.ITU601: (ColorPrimaries.SMPTE170M, ColorTrc.SMPTE170M),
}


class Movie(ABC):
    """One file with one stream of pictures of one shape."""

    def __init__(self, path: Path, shape: tuple[int, ...], frame_rate: Fraction) -> None:
        self._path, self._shape, self._rate = path, shape, frame_rate
        self._stack = ExitStack()
        self.frames = 0

    def _begin(
        self, kind: str, container: dict[str, str], coder: str, options: dict[str, str]
    ) -> Any:
        """Open the file; the stream has its rate, but neither size nor format yet."""
        with ExitStack() as stack:
            part = stack.enter_context(whole_file(self._path))
            self._file = stack.enter_context(
                av.open(str(part), "w", format=kind, options=container)
            )
            self._stream: Any = self._file.add_stream(coder, rate=self._rate, options=options)
            self._stream.codec_context.thread_count = THREADS
            self._stream.codec_context.time_base = 1 / self._rate
            self._stack = stack.pop_all()
        return self._stream

    def _halved(self, stream: Any, pixels: str, matrix: Colorspace) -> None:
        """Size and format of a film with colours at half the size: sides even, range limited."""
        height, width = self._shape[:2]
        self._odd = height % 2, width % 2
        stream.height, stream.width = height + self._odd[0], width + self._odd[1]
        stream.pix_fmt = pixels
        coder = stream.codec_context
        coder.gop_size = max(1, round(_KEY_EVERY_S * self._rate))
        coder.color_range, coder.colorspace = ColorRange.MPEG, matrix
        coder.color_primaries, coder.color_trc = _COLOURS[matrix]

    def _even(self, frame: NDArray[np.uint8], border: int) -> NDArray[np.uint8]:
        """A frame with the sides that `_halved` has set; `border`: what is added, for OpenCV."""
        if not any(self._odd):
            return frame
        return cv2.copyMakeBorder(frame, 0, self._odd[0], 0, self._odd[1], border)

    @abstractmethod
    def __enter__(self) -> Self: ...

    @abstractmethod
    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append one frame, uint8 of the film's shape."""

    def _encode(self, frame: VideoFrame) -> None:
        frame.pts, frame.time_base = self.frames, 1 / self._rate
        self._file.mux(self._stream.encode(frame))
        self.frames += 1

    def _check(self, frame: NDArray[np.uint8]) -> None:
        if frame.shape != self._shape or frame.dtype != np.uint8:
            raise ValueError(f"frame {frame.shape} {frame.dtype}, wanted {self._shape} uint8")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool | None:
        with self._stack as stack:
            if kind is None:
                self._file.mux(self._stream.encode(None))
            stack_exit = stack.pop_all()
        return stack_exit.__exit__(kind, error, trace)


_LIMITED = np.round(16 + np.arange(256) * 219 / 255).astype(np.uint8)


def _coded(frame: NDArray[np.uint8], matrix: Colorspace) -> VideoFrame:
    """A picture of even sides as 4:2:0 of limited range."""
    if frame.ndim == 2:  # swscale would give grey a tint, and not always the same
        height, width = frame.shape
        planes = np.full((height * 3 // 2, width), 128, np.uint8)
        cv2.LUT(frame, _LIMITED, dst=planes[:height])
        return VideoFrame.from_ndarray(planes, format="yuv420p")
    return VideoFrame.from_ndarray(frame, format="rgb24").reformat(
        format="yuv420p",
        dst_colorspace=matrix,
        dst_color_range=ColorRange.MPEG,
        threads=THREADS,
    )


class Mp4Writer(Movie):
    """H.264, 4:2:0, limited range, BT.709, its index at the front: what browsers play at once.

    4:2:0 wants even sides: a last odd row or column is repeated once, so that nothing is lost.

    Parameters
    ----------
    path
        Where the .mp4 goes.
    shape
        (h, w) or (h, w, 3) of every frame.
    frame_rate
        Frames per second.
    crf
        Quality of libx264, 0 = best, 51 = worst.
    """

    def __init__(self, path: Path, shape: tuple[int, ...], frame_rate: Fraction, crf: int) -> None:
        super().__init__(path, shape, frame_rate)
        self._crf = crf

    def __enter__(self) -> Self:
        # With B-frames, looking ahead or weights x264 does not always give the same bytes.
        options = {"crf": str(self._crf), "preset": "veryfast", "bf": "0", "x264-params": _SAME}
        stream = self._begin("mp4", {"movflags": "+faststart"}, "libx264", options)
        self._halved(stream, "yuv420p", Colorspace.ITU709)
        return self

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append one frame."""
        self._check(frame)
        self._encode(_coded(self._even(frame, cv2.BORDER_REPLICATE), Colorspace.ITU709))


class WebpWriter(Movie):
    """An animated WebP that repeats for ever, made smaller.

    Parameters
    ----------
    path
        Where the .webp goes.
    shape
        (h, w) or (h, w, 3) of every frame.
    frame_rate
        Frames per second; a frame begins at a whole millisecond.
    width
        Of the picture in the file, px; never more than the frames', and even as the height is.
    quality
        0 … 100, lossy.
    """

    def __init__(
        self, path: Path, shape: tuple[int, ...], frame_rate: Fraction, width: int, quality: int
    ) -> None:
        super().__init__(path, shape, frame_rate)
        self._quality = quality
        wide = min(width, shape[1])
        self._size = 2 * max(1, wide // 2), 2 * max(1, round(shape[0] * wide / shape[1] / 2))

    def __enter__(self) -> Self:
        # Method 2: as fast as 0, 3 % larger than 4, which takes three times as long.
        options = {"quality": str(self._quality), "compression_level": "2"}
        stream = self._begin("webp", {"loop": "0"}, "libwebp_anim", options)
        (stream.width, stream.height), stream.pix_fmt = self._size, "yuv420p"
        return self

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append one frame."""
        self._check(frame)
        small = cv2.resize(frame, self._size, interpolation=cv2.INTER_AREA)
        self._encode(_coded(small, Colorspace.ITU601))  # what WebP is defined in
