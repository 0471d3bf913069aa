"""A decoded frame as an array of 8 bits, by the range and colours that the film states."""

from typing import Any

import cv2
import numpy as np
from av.sidedata.sidedata import Type as SideDataType
from av.video.frame import VideoFrame
from av.video.reformatter import ColorRange, Colorspace

from finloop.io.footage.coding import FULL_FROM_LIMITED, stretch_levels
from finloop.io.video import THREADS, luma

HD_HEIGHT = 720  # from here on, a film that does not state its colour matrix has BT.709
_LUMA_FIRST = ("yuv4", "yuvj4", "yuva4", "nv1", "nv2", "gray")  # formats whose plane 0 is Y


def display_matrix(frame: VideoFrame) -> np.ndarray:
    """Return the matrix (9 numbers) by which a player turns a frame upright; see `turn_of`."""
    side: Any
    for side in frame.side_data:
        if side.type == SideDataType.DISPLAYMATRIX:
            return np.frombuffer(bytes(side), np.int32)
    return np.eye(3).ravel()


def is_yuv(frame: VideoFrame) -> bool:
    """Return whether the frame is coded as brightness and two colour differences."""
    return frame.format.name.startswith(("yuv", "nv", "uyvy", "yvyu", "p0"))


def is_deep(frame: VideoFrame) -> bool:
    """Return whether a frame is grey with more than 8 bits; it does not state how many are used."""
    return len(frame.format.components) == 1 and frame.format.components[0].bits > 8


def grey(frame: VideoFrame, full_range: bool, levels: tuple[float, float] | None) -> np.ndarray:
    """Convert a decoded frame to grey (h, w) uint8, 0 = black, 255 = white.

    full_range: read Y as 0 … 255 even if the frame does not say so; else limited range is expanded.
    levels: of a frame of more than 8 bits, those that become 0 and 255; None for 8 bits.
    """
    if levels:
        return stretch_levels(frame.to_ndarray(format="gray16le"), *levels)
    name, bits = frame.format.name, frame.format.components[0].bits
    if bits == 8 and name.startswith(_LUMA_FIRST):  # the general conversion is 20 times slower
        full = full_range or name == "gray" or frame.color_range == ColorRange.JPEG
        return luma(frame) if full else cv2.LUT(luma(frame), FULL_FROM_LIMITED)
    return frame.to_ndarray(
        format="gray",
        src_color_range=ColorRange.JPEG if full_range else frame.color_range,
        dst_color_range=ColorRange.JPEG,
        threads=THREADS,
    )


def rgb(frame: VideoFrame, full_range: bool) -> np.ndarray:
    """Convert a decoded frame to RGB (h, w, 3) uint8, by the range and matrix that it states.

    full_range: read it as full range even if it does not say so.
    """
    matrix = frame.colorspace
    if matrix not in list(Colorspace):
        matrix = Colorspace.ITU709 if frame.height >= HD_HEIGHT else Colorspace.ITU601
    return frame.to_ndarray(
        format="rgb24",
        src_colorspace=matrix,
        src_color_range=ColorRange.JPEG if full_range else frame.color_range,
        dst_color_range=ColorRange.JPEG,
        threads=THREADS,
    )
