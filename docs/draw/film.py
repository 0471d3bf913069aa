"""Films of the pipeline as small animated WebP."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import av
import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Picture = NDArray[np.uint8]

RATE_HZ = 12.5  # frame rate of every animated picture
QUALITY = 60  # WebP quality, at most 100
NOISE_GREY = 14  # smaller changes from frame to frame are noise, which makes the file large
STRIP_PX, STRIP, TEXT = 40, (24, 36, 43), (240, 245, 247)
FONT = Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"


def frames(path: Path, start_s: float = 0.0, end_s: float = np.inf) -> Iterator[Picture]:
    """Yield the frames of a film, (height, width, 3), at `RATE_HZ`."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        rate = float(stream.average_rate or RATE_HZ)
        due = start_s
        for number, frame in enumerate(container.decode(stream)):
            if number / rate >= end_s:
                return
            if number / rate >= due - 1e-6:
                due += 1 / RATE_HZ
                yield frame.to_ndarray(format="rgb24")


def resize_picture(picture: Picture, width_px: int) -> Picture:
    """Resize the picture to another width [px]."""
    height_px = round(picture.shape[0] * width_px / picture.shape[1])
    return cv2.resize(picture, (width_px, height_px), interpolation=cv2.INTER_AREA)


def steady(film: Iterable[Picture]) -> Iterator[Picture]:
    """Yield the film without noise: a pixel keeps its colour until it changes beyond noise."""
    last: Picture | None = None
    for picture in film:
        if last is None:
            last = picture
        change = cv2.blur(cv2.absdiff(picture, last).max(axis=2), (3, 3)) > NOISE_GREY
        moving = cv2.dilate(change.astype(np.uint8), np.ones((9, 9), np.uint8))
        last = np.where(moving[..., None] > 0, picture, last)
        yield last


def window(
    film: Iterable[Picture], places: Callable[[float], tuple[float, float]], size: tuple[int, int]
) -> Iterator[Picture]:
    """Yield a window of `size` (width, height) px that follows `places`, a function of time [s]."""
    width, height = size
    for number, picture in enumerate(film):
        x, y = places(number / RATE_HZ)
        left = int(np.clip(x - width / 2, 0, picture.shape[1] - width))
        top = int(np.clip(y - height / 2, 0, picture.shape[0] - height))
        yield picture[top : top + height, left : left + width]


def add_caption(film: Iterable[Picture], words: str) -> Iterator[Picture]:
    """Yield the film above a strip with a caption."""
    strip = None
    for picture in film:
        if strip is None:
            image = Image.new("RGB", (picture.shape[1], STRIP_PX), STRIP)
            font = ImageFont.truetype(str(FONT), STRIP_PX // 2)
            middle = (14, STRIP_PX // 2)
            ImageDraw.Draw(image).text(middle, words, TEXT, font, anchor="lm")
            strip = np.asarray(image)
        yield np.vstack([picture, strip])


def save_film(path: Path, film: Iterable[Picture]) -> None:
    """Write an animated WebP that loops endlessly."""
    first, *rest = [Image.fromarray(picture) for picture in film]
    how = {"duration": round(1000 / RATE_HZ), "loop": 0, "quality": QUALITY, "method": 4}
    first.save(path, save_all=True, append_images=rest, **how)


def save_still(path: Path, picture: Picture, quality: int = 80) -> None:
    """Write a WebP of one frame."""
    Image.fromarray(picture).save(path, quality=quality, method=6)
