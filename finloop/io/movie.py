"""Write films frame by frame: the normalised clip, MP4 for browsers, WebM, animated WebP.

Frames are (h, w) grey, (h, w, 3) RGB or, of an animal without its tank, (h, w, 4) RGBA uint8 with
straight alpha. A file appears under its name when it is complete; the same frames give the same
bytes.
"""

from abc import ABC, abstractmethod
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import av
import cv2
import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc, Interpolation

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.io.atomic import whole_file
from finloop.io.video import KEY_FRAME_EVERY, THREADS, VideoFacts, read_frames

# With B-frames, look-ahead or weights x264 reads uninitialised memory: its output would then depend
# on what else the process has done.
_REPEATABLE = {"bf": "0", "x264-params": "mbtree=0:rc-lookahead=0:weightp=0"}
_GRAIN = {"tune": "grain"}  # x264 would smooth a tank's grain, and spend more on it
_MOST_WAITING = 4  # frames that wait to be coded
_KEY_EVERY_S = 2  # a player can seek to every two seconds
_COLOURS = {
    Colorspace.ITU709: (ColorPrimaries.BT709, ColorTrc.BT709),
    Colorspace.ITU601: (ColorPrimaries.SMPTE170M, ColorTrc.SMPTE170M),
}
_LIMITED = np.round(16 + np.arange(256) * 219 / 255).astype(np.uint8)
_SMALL_CRF, _SMALL_WIDTHS = 28, (960, 640, 426)  # coding and px of a film made smaller


class FilmWriter(ABC):
    """Writer of a film file, frame by frame, in a `with` block; subclasses name the format.

    The film appears at `path` when the block succeeds. A thread codes frames while the caller makes
    the next ones; a later `write`, or the end of the block, raises its errors: FinloopError if the
    disk is full. shape: of every frame, (h, w) or (h, w, channels). frame_rate: frames per second.
    quality: a number on the scale that the subclass names.
    """

    def __init__(
        self, path: Path, shape: tuple[int, ...], frame_rate: Fraction, quality: int
    ) -> None:
        """Prepare a writer; the file is opened by the `with` block."""
        self.path, self._shape, self._rate = path, shape, frame_rate
        self._quality = str(quality)
        self._stack = ExitStack()
        self._waiting = deque[Future[None]]()
        self.frames = 0  # frames written
        self._bytes, self._broken = 0, False

    def _open_stream(
        self, kind: str, container: dict[str, str], coder: str, options: dict[str, str]
    ) -> Any:
        """Open the film file and return its video stream, which has no size or pixel format yet.

        kind: FFmpeg's name of the file format. container: FFmpeg's options of the file. coder:
        FFmpeg's name of the coder. options: of the coder.
        """
        with ExitStack() as stack:  # what is open is closed if a line below fails
            part = stack.enter_context(whole_file(self.path))
            self._file = stack.enter_context(
                av.open(str(part), "w", format=kind, options=container)
            )
            self._stream: Any = self._file.add_stream(coder, rate=self._rate, options=options)
            self._stream.codec_context.thread_count = THREADS
            self._stream.codec_context.time_base = 1 / self._rate
            self._coder = stack.enter_context(ThreadPoolExecutor(1, "film"))
            stack.push(self._finish)
            self._stack = stack.pop_all()  # from now on `__exit__` closes it
        return self._stream

    def _set_yuv420_format(self, stream: Any, pixels: str, matrix: Colorspace) -> None:
        """Set a stream to even sides, limited range (16 … 235) and colours at half the resolution.

        stream: changes. pixels: FFmpeg's name of its pixel format. matrix: how RGB becomes
        brightness and colours.
        """
        height, width = self._shape[:2]
        self._odd = height % 2, width % 2
        stream.height, stream.width = height + self._odd[0], width + self._odd[1]
        stream.pix_fmt = pixels
        coder = stream.codec_context
        coder.gop_size = max(1, round(_KEY_EVERY_S * self._rate))
        coder.color_range, coder.colorspace = ColorRange.MPEG, matrix
        coder.color_primaries, coder.color_trc = _COLOURS[matrix]

    def _pad_to_even(self, frame: Picture, border: int) -> Picture:
        """Return a frame with even sides, padded at the right and bottom.

        border: OpenCV's border type, which says with what.
        """
        if not any(self._odd):
            return frame
        return cv2.copyMakeBorder(frame, 0, self._odd[0], 0, self._odd[1], border)

    @abstractmethod
    def __enter__(self) -> Self:
        """Open the file and return this writer."""

    @abstractmethod
    def _convert_frame(self, frame: Picture) -> VideoFrame:
        """Convert a frame to the stream's pixel format."""

    def write(self, frame: Picture) -> None:
        """Append one frame, uint8, of the film's shape; ValueError for any other."""
        if frame.shape != self._shape or frame.dtype != np.uint8:
            raise ValueError(f"frame {frame.shape} {frame.dtype}, wanted {self._shape} uint8")
        self._wait_until_fewer(_MOST_WAITING)
        self._waiting.append(self._coder.submit(self._encode, frame.copy(), self.frames))
        self.frames += 1

    def bytes_per_frame(self) -> float:
        """Return the mean coded size of a frame [bytes]; wait until all frames are coded."""
        self._wait_until_fewer(1)
        return self._bytes / self.frames

    def _encode(self, frame: Picture, number: int) -> None:
        """Code one frame and write it to the file; do nothing if an earlier frame has failed.

        number: of the frame, from 0.
        """
        if self._broken:  # writing after an error crashes the library
            return
        self._broken = True  # until this frame has succeeded
        coded = self._convert_frame(frame)
        coded.pts, coded.time_base = number, 1 / self._rate
        packets = self._stream.encode(coded)
        self._file.mux(packets)
        self._bytes += sum(packet.size for packet in packets)
        self._broken = False

    def _wait_until_fewer(self, most: int) -> None:
        """Wait until fewer than `most` frames are waiting to be coded; raise their errors."""
        while len(self._waiting) >= most:
            self._waiting.popleft().result()

    def _finish(self, error: Any, *_: Any) -> None:
        """Code the last frames at the end of the `with` block; drop them if it raised `error`."""
        if error is None:
            self._wait_until_fewer(1)
            self._file.mux(self._stream.encode(None))
        for coding in self._waiting:
            coding.cancel()

    def __exit__(self, *error: Any) -> bool | None:
        """Close the file and let it appear at its path, or remove it after an error."""
        return self._stack.__exit__(*error)


def _convert_to_yuv(
    frame: Picture, matrix: Colorspace, size: tuple[int, int] | None = None
) -> VideoFrame:
    """Convert a frame, grey or RGB, to YUV 4:2:0 of limited range (16 … 235).

    matrix: how RGB becomes brightness and colours. size: even width and height of the result [px];
    None = those of the frame.
    """
    width, height = frame.shape[1::-1] if size is None else size
    if frame.ndim == 2:  # swscale gives grey a tint that varies
        if size is not None:
            frame = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
        planes = np.full((height * 3 // 2, width), 128, np.uint8)  # 128: no colour
        cv2.LUT(frame, _LIMITED, dst=planes[:height])
        return VideoFrame.from_ndarray(planes, format="yuv420p")
    # In place, and by one thread: half the processor time of a copy and two threads.
    return VideoFrame.from_numpy_buffer(frame, format="rgb24").reformat(
        width, height, "yuv420p", dst_colorspace=matrix, dst_color_range=ColorRange.MPEG,
        interpolation=None if size is None else Interpolation.AREA, threads=1,
    )  # fmt: skip


class VideoWriter(FilmWriter):
    """Writer of the normalised clip: H.264 of constant frame rate, whose pixels can be read back.

    Mono film is coded as 4:0:0, so the decoded Y plane *is* the picture. Colour film is coded in
    full-range BT.601, 4:2:0 if both sides are even and 4:4:4 if one is odd, so no row or column is
    lost. Every `KEY_FRAME_EVERY`-th frame is a key frame, where reading can begin. colour: frames
    are RGB instead of grey. crf: 0 = lossless (grey bit for bit; RGB up to the rounding of its YUV
    form), 51 = worst.
    """

    def __init__(
        self, path: Path, width: int, height: int, frame_rate: Fraction, colour: bool = False,
        crf: int = 0,
    ) -> None:  # fmt: skip
        """Prepare a writer of frames (height, width) grey or, if `colour`, RGB."""
        super().__init__(path, (height, width, 3) if colour else (height, width), frame_rate, crf)
        even = height % 2 == 0 and width % 2 == 0
        self._format = ("yuv420p" if even else "yuv444p") if colour else "gray"

    @classmethod
    def from_facts(cls, path: Path, facts: VideoFacts) -> Self:
        """Return a writer of a clip with the size, frame rate, colour and quality in `facts`."""
        size = facts.width_px, facts.height_px
        return cls(path, *size, facts.frame_rate, facts.colour, facts.crf)

    def __enter__(self) -> Self:
        """Open an MP4 file with a H.264 stream and return this writer."""
        options = (
            {"qp": "0", "preset": "ultrafast"}
            if self._quality == "0"
            else {"crf": self._quality, "preset": "veryfast"} | _REPEATABLE
        )
        stream = self._open_stream("mp4", {}, "libx264", options)
        stream.height, stream.width = self._shape[:2]
        stream.pix_fmt = self._format
        coder = stream.codec_context
        coder.gop_size = KEY_FRAME_EVERY
        coder.color_range, coder.colorspace = ColorRange.JPEG, Colorspace.ITU601
        return self

    def _convert_frame(self, frame: Picture) -> VideoFrame:
        """Convert a grey or RGB frame to the clip's pixel format, full range."""
        if frame.ndim == 2:
            picture = VideoFrame.from_ndarray(frame, format="gray")
            picture.color_range = ColorRange.JPEG
            return picture
        return VideoFrame.from_ndarray(frame, format="rgb24").reformat(
            format=self._format, dst_colorspace=Colorspace.ITU601,
            dst_color_range=ColorRange.JPEG, threads=THREADS,
        )  # fmt: skip


class Mp4Writer(FilmWriter):
    """Writer of H.264 in MP4 for every browser: 4:2:0, limited range, BT.709, index in front.

    Frames are RGB; a last odd row or column is repeated once. Quality: 0 = best, 51 = worst.
    """

    def __enter__(self) -> Self:
        """Open an MP4 file with a H.264 stream and return this writer."""
        options = {"crf": self._quality, "preset": "veryfast"} | _REPEATABLE | _GRAIN
        stream = self._open_stream("mp4", {"movflags": "+faststart"}, "libx264", options)
        self._set_yuv420_format(stream, "yuv420p", Colorspace.ITU709)
        return self

    def _convert_frame(self, frame: Picture) -> VideoFrame:
        """Convert an RGB frame, padded to even sides, to YUV 4:2:0, BT.709, limited range."""
        return _convert_to_yuv(self._pad_to_even(frame, cv2.BORDER_REPLICATE), Colorspace.ITU709)


class WebpWriter(FilmWriter):
    """Writer of an animated WebP that repeats for ever; frames begin at whole milliseconds.

    Frames are RGB. width: px of the picture in the file, at most that of the frames; both sides
    become even. Quality: 0 = worst, 100 = best.
    """

    def __init__(
        self, path: Path, shape: tuple[int, ...], frame_rate: Fraction, width: int, quality: int
    ) -> None:
        """Prepare a writer of RGB frames of a shape (h, w, 3), scaled down to `width` px."""
        super().__init__(path, shape, frame_rate, quality)
        width = min(width, shape[1])
        self._size = 2 * max(1, width // 2), 2 * max(1, round(shape[0] * width / shape[1] / 2))

    def __enter__(self) -> Self:
        """Open an animated WebP file and return this writer."""
        # Method 2 is as fast as 0; method 4 makes 3 % smaller files and takes three times as long.
        options = {"quality": self._quality, "compression_level": "2"}
        stream = self._open_stream("webp", {"loop": "0"}, "libwebp_anim", options)
        (stream.width, stream.height), stream.pix_fmt = self._size, "yuv420p"
        return self

    def _convert_frame(self, frame: Picture) -> VideoFrame:
        """Convert an RGB frame to the size of the file and to YUV 4:2:0, BT.601."""
        return _convert_to_yuv(frame, Colorspace.ITU601, self._size)  # as WebP is defined


class WebmWriter(FilmWriter):
    """Writer of a transparent WebM, which browsers and editors overlay: VP9 with alpha.

    Frames are RGBA; an odd side gets one more transparent row or column. Quality: 0 = best, 63 =
    worst.
    """

    def __enter__(self) -> Self:
        """Open a WebM file with a VP9 stream and return this writer."""
        # Speed 8 of "realtime" is four times as fast as "good", for files of the same size. Coded
        # as a screen, where little moves, a fish leaves fewer traces in the alpha behind it. A
        # hidden frame (auto-alt-ref, lag) would be in only one of the two pictures.
        options = {
            "crf": self._quality, "b": "0", "deadline": "realtime", "cpu-used": "8",
            "tune-content": "screen", "auto-alt-ref": "0", "lag-in-frames": "0",
        }  # fmt: skip
        container = {"fflags": "bitexact"}  # else a random number names the file
        stream = self._open_stream("webm", container, "libvpx-vp9", options)
        self._set_yuv420_format(stream, "yuva420p", Colorspace.ITU601)
        return self

    def _convert_frame(self, frame: Picture) -> VideoFrame:
        """Convert an RGBA frame, padded to even sides, to YUV 4:2:0 of limited range, BT.601.

        Alpha does not change. OpenCV converts: swscale takes three times as long, and changes
        alpha by 1.
        """
        frame = self._pad_to_even(frame, cv2.BORDER_CONSTANT)
        height, width = frame.shape[:2]
        yuv = cv2.cvtColor(frame, cv2.COLOR_RGBA2YUV_I420)
        chroma = yuv[height:].reshape(2, height // 2, width // 2)
        coded = VideoFrame(width, height, "yuva420p")
        planes = (yuv[:height], *chroma, frame[..., 3])
        for plane, pixels in zip(coded.planes, planes, strict=True):
            rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
            rows[: plane.height, : plane.width] = pixels
        return coded


class AlphaWebpWriter(FilmWriter):
    """Writer of a transparent animated WebP that repeats for ever; alpha is kept without loss.

    Frames are RGBA and begin at whole milliseconds. Quality of the colours: 0 = worst, 100 = best.
    """

    def __enter__(self) -> Self:
        """Open an animated WebP file and return this writer."""
        options = {"quality": self._quality, "compression_level": "2"}
        stream = self._open_stream("webp", {"loop": "0"}, "libwebp_anim", options)
        stream.height, stream.width = self._shape[:2]
        stream.pix_fmt = "bgra"  # the coder's own order: it makes 4:2:0 itself, and respects alpha
        return self

    def _convert_frame(self, frame: Picture) -> VideoFrame:
        """Convert an RGBA frame to BGRA, the order that the WebP coder reads."""
        return VideoFrame.from_ndarray(cv2.cvtColor(frame, cv2.COLOR_RGBA2BGRA), format="bgra")


def load_film_below_size(path: Path, most_bytes: int) -> tuple[bytes, Picture]:
    """Return the bytes of an MP4 film of limited size, for a web page, and its first frame.

    A film of more than `most_bytes` is coded again, narrower. The first frame (h, w, 3), RGB uint8,
    keeps its size. FinloopError if the film cannot be read, or is too long to become so small.
    """
    poster = next(iter(read_frames(path, colour=True)))
    film = path.read_bytes()
    for width in _SMALL_WIDTHS:
        if len(film) > most_bytes:
            film = _recode_narrower(path, poster.shape, width)
    if len(film) > most_bytes:
        raise FinloopError(
            f"{path} has {len(film) / 1e6:.1f} MB even at a width of {_SMALL_WIDTHS[-1]} px",
            f"a film of at most {most_bytes / 1e6:.1f} MB",
            "raise report.max_film_mb, or lower animate.seconds",
        )
    return film, poster


def _recode_narrower(path: Path, shape: tuple[int, ...], width: int) -> bytes:
    """Return the bytes of an MP4 film coded again, at most `width` px wide.

    path: of the film. shape: of its frames, height and width [px] first.
    """
    width = min(width, shape[1])
    size = width, max(2, round(shape[0] * width / shape[1]))
    with av.open(str(path)) as container:
        rate = Fraction(container.streams.video[0].average_rate or 25)
    with TemporaryDirectory() as folder:
        small = Path(folder) / "film.mp4"
        with Mp4Writer(small, (size[1], size[0], 3), rate, _SMALL_CRF) as writer:
            for frame in read_frames(path, colour=True):
                writer.write(cv2.resize(frame, size, interpolation=cv2.INTER_AREA))
        return small.read_bytes()
