"""Films of a fish without its tank, to lay over anything: VP9 in WebM, and animated WebP.

Frames are (h, w, 4) RGBA uint8 with straight alpha, as both formats store it. A file appears under
its name when it is complete; the same frames give the same bytes.
"""

from typing import Self

import cv2
import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import Colorspace

from finloop.base.arrays import Picture
from finloop.io.movie import Movie


class WebmWriter(Movie):
    """Writer of a transparent WebM, which browsers and editors overlay: VP9 with alpha.

    Frames are (h, w, 4) RGBA. 4:2:0 needs even sides: an odd side gets one more transparent row or
    column. Quality of libvpx: 0 = best, 63 = worst.
    """

    def __enter__(self) -> Self:
        # Speed 8 of "realtime" is four times as fast as "good", for files of the same size. Coded
        # as a screen, where little moves, a fish leaves fewer traces in the alpha behind it. A
        # hidden frame (auto-alt-ref, lag) would be in only one of the two pictures.
        options = {
            "crf": self._quality, "b": "0", "deadline": "realtime", "cpu-used": "8",
            "tune-content": "screen", "auto-alt-ref": "0", "lag-in-frames": "0",
        }  # fmt: skip
        container = {"fflags": "bitexact"}  # else a random number names the file
        stream = self._begin("webm", container, "libvpx-vp9", options)
        self._set_half_chroma(stream, "yuva420p", Colorspace.ITU601)
        return self

    def _convert_frame(self, frame: Picture) -> VideoFrame:
        """Convert a frame to 4:2:0 of limited range, BT.601; alpha stays unchanged.

        OpenCV does it: swscale takes three times as long, and changes alpha by 1.
        """
        frame = self._even(frame, cv2.BORDER_CONSTANT)
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
    """Writer of a transparent animated WebP that repeats for ever; alpha is kept without loss.

    Frames are (h, w, 4) RGBA and begin at whole milliseconds. Quality of the colours: 0 = worst,
    100 = best.
    """

    def __enter__(self) -> Self:
        options = {"quality": self._quality, "compression_level": "2"}
        stream = self._begin("webp", {"loop": "0"}, "libwebp_anim", options)
        stream.height, stream.width = self._shape[:2]
        stream.pix_fmt = "bgra"  # the coder's own order: it makes 4:2:0 itself, and respects alpha
        return self

    def _convert_frame(self, frame: Picture) -> VideoFrame:
        return VideoFrame.from_ndarray(cv2.cvtColor(frame, cv2.COLOR_RGBA2BGRA), format="bgra")
