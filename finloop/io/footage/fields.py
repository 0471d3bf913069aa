"""Deinterlacing by FFmpeg's filter bwdif, one picture a frame."""

from collections.abc import Iterator
from typing import Literal

from av.filter import Graph
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

Order = Literal["", "auto", "tff", "bff"]
"""Which field is earlier: upper (tff), lower (bff), as the film states (auto); "" = no fields."""


def deinterlace(
    frames: Iterator[VideoFrame | None], stream: VideoStream, order: Order
) -> Iterator[VideoFrame | None]:
    """Yield the frames deinterlaced: the rows of each frame's later field are interpolated.

    order: which field is earlier. A damaged frame, None, stays None.
    """
    graph = Graph()
    source = graph.add_buffer(template=stream)
    weave = graph.add("bwdif", f"mode=send_frame:parity={order}:deint=all")
    sink = graph.add("buffersink")
    source.link_to(weave)
    weave.link_to(sink)
    graph.configure()
    for frame in frames:
        if frame is None:
            yield None
            continue
        graph.push(frame)
        yield from _ready(graph, stream)
    graph.push(None)
    yield from _ready(graph, stream)


def _ready(graph: Graph, stream: VideoStream) -> Iterator[VideoFrame]:
    """Yield what the filter has finished, in the stream's ticks; it is a frame behind."""
    while True:
        try:
            frame = graph.pull()
        except (BlockingIOError, EOFError):
            return
        assert isinstance(frame, VideoFrame)
        if frame.pts is not None and stream.time_base and frame.time_base:
            frame.pts = round(frame.pts * frame.time_base / stream.time_base)
            frame.time_base = stream.time_base
        yield frame
