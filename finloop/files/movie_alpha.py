"""Films of a fish without its tank, to lay over anything: VP9 in WebM, and animated WebP.

Frames are (h, w, 4) RGBA uint8 with straight alpha, as both formats want it. The file appears under
its name when it is whole; the same frames give the same bytes.
"""

from fractions import Fraction
from pathlib import Path
from typing import Self

import cv2
import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from numpy.typing import NDArray

from finloop.files.movie import Movie

_KEY_EVERY_S = 2  # a player can jump to every two seconds


class WebmWriter(Movie):
    """VP9 with a second, equally coded picture for alpha: what browsers and editors overlay.

    4:2:0 wants even sides: an odd one gets a transparent row or column more.

    Parameters
    ----------
    path
        Where the .webm goes.
    shape
        (h, w, 4) of every frame.
    frame_rate
        Frames per second.
    crf
        Quality of libvpx, 0 = best, 63 = worst.
    """

    def __init__(self, path: Path, shape: tuple[int, ...], frame_rate: Fraction, crf: int) -> None:
        super().__init__(path, shape, frame_rate)
        self._crf = crf

    def __enter__(self) -> Self:
        # Speed 8 of "realtime" is four times as fast as "good", the files as large. Coded as a
        # screen, where little moves, a fish leaves fewer traces in the alpha behind it. A frame
        # that is not shown (auto-alt-ref, lag) would come in one of the two pictures alone.
        options = {
            "crf": str(self._crf), "b": "0", "deadline": "realtime", "cpu-used": "8",
            "tune-content": "screen", "auto-alt-ref": "0", "lag-in-frames": "0",
        }  # fmt: skip
        container = {"fflags": "bitexact"}  # else a random number names the file
        stream = self._begin("webm", container, "libvpx-vp9", options)
        height, width = self._shape[:2]
        self._odd = height % 2, width % 2
        stream.height, stream.width = height + self._odd[0], width + self._odd[1]
        stream.pix_fmt = "yuva420p"
        coder = stream.codec_context
        coder.gop_size = max(1, round(_KEY_EVERY_S * self._rate))
        coder.color_range, coder.colorspace = ColorRange.MPEG, Colorspace.ITU601
        coder.color_primaries, coder.color_trc = ColorPrimaries.SMPTE170M, ColorTrc.SMPTE170M
        return self

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append one frame."""
        self._check(frame)
        if any(self._odd):
            frame = cv2.copyMakeBorder(
                frame, 0, self._odd[0], 0, self._odd[1], cv2.BORDER_CONSTANT, value=(0, 0, 0, 0)
            )
        self._encode(_coded(frame))


def _coded(frame: NDArray[np.uint8]) -> VideoFrame:
    """RGBA of even sides as 4:2:0 of limited range, BT.601, with alpha as it is.

    By OpenCV: swscale takes three times as long, and changes alpha by 1.
    """
    height, width = frame.shape[:2]
    yuv = cv2.cvtColor(frame, cv2.COLOR_RGBA2YUV_I420)
    chroma = yuv[height:].reshape(2, height // 2, width // 2)
    coded = VideoFrame(width, height, "yuva420p")
    planes = (yuv[:height], *chroma, frame[..., 3])
    for plane, pixels in zip(coded.planes, planes, strict=True):
        rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
        rows[: plane.height, : plane.width] = pixels
    return coded


class AlphaWebpWriter(Movie):
    """An animated WebP with alpha that repeats for ever; alpha is kept without loss.

    Parameters
    ----------
    path
        Where the .webp goes.
    shape
        (h, w, 4) of every frame.
    frame_rate
        Frames per second; a frame begins at a whole millisecond.
    quality
        Of the colours, 0 … 100.
    """

    def __init__(
        self, path: Path, shape: tuple[int, ...], frame_rate: Fraction, quality: int
    ) -> None:
        super().__init__(path, shape, frame_rate)
        self._quality = quality

    def __enter__(self) -> Self:
        options = {"quality": str(self._quality), "compression_level": "2"}
        stream = self._begin("webp", {"loop": "0"}, "libwebp_anim", options)
        stream.height, stream.width = self._shape[:2]
        stream.pix_fmt = "bgra"  # the coder's own order: it makes 4:2:0 itself, alpha in mind
        return self

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append one frame."""
        self._check(frame)
        bgra = cv2.cvtColor(frame, cv2.COLOR_RGBA2BGRA)
        self._encode(VideoFrame.from_ndarray(bgra, format="bgra"))
