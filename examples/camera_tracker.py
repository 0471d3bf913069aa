"""A small tracker for the stimulus: `python examples/camera_tracker.py 0 --animals 2`.

It reads a camera (by number) or a film file, detects animals by their difference from the
background, and sends their places to finloop: t in seconds, id, and x, y in px of the picture.
The background is the median of some frames: from the camera's first seconds, or from all the film.
--to udp://127.0.0.1:9000, or ws://127.0.0.1:8000/animals (the address of the stimulus's page).
"""

import argparse
import contextlib
import itertools
import json
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from urllib.parse import urlsplit

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment
from websockets.sync.client import connect


def median_background(film: cv2.VideoCapture, count: int = 31) -> np.ndarray:
    """Return the median of some grey frames, and rewind a film."""
    grey, frames = [], int(film.get(cv2.CAP_PROP_FRAME_COUNT))
    for number in range(count):
        film.set(cv2.CAP_PROP_POS_FRAMES, number * frames // count)
        time.sleep(0.3 if frames <= 0 else 0)  # a camera has no number of frames
        grey.append(cv2.cvtColor(film.read()[1], cv2.COLOR_BGR2GRAY))
    film.set(cv2.CAP_PROP_POS_FRAMES, 0)
    return np.median(grey, axis=0).astype(np.float32)


def read_frames(film: cv2.VideoCapture) -> Iterator[tuple[float, np.ndarray]]:
    """Yield time (s) and grey picture of each frame; a film plays at its own rate."""
    is_film, begin = film.get(cv2.CAP_PROP_FRAME_COUNT) > 0, time.perf_counter()
    for number in itertools.count():
        there, frame = film.read()
        if not there:
            return
        t = time.perf_counter() - begin
        if is_film:
            due = number / film.get(cv2.CAP_PROP_FPS)
            time.sleep(max(0.0, due - t))
            t = due
        yield t, cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)


def find_blobs(
    grey: np.ndarray, background: np.ndarray, least: np.ndarray, most: int
) -> np.ndarray:
    """Return the centres (n, 2) px of the largest blobs; adapt the background elsewhere."""
    mask = np.uint8(cv2.absdiff(grey, cv2.convertScaleAbs(background)) > least)
    mask = cv2.medianBlur(mask, 5)
    cv2.accumulateWeighted(grey, background, 0.01, 1 - mask)
    _, _, stats, centres = cv2.connectedComponentsWithStats(mask)
    areas = stats[1:, cv2.CC_STAT_AREA]
    largest = np.argsort(-areas)[:most]
    return centres[1:][largest[areas[largest] > 0.2 * areas.max(initial=0)]]


def track_animals(
    frames: Iterable[tuple[float, np.ndarray]], background: np.ndarray, least: np.ndarray, most: int
) -> Iterator[list[dict[str, float]]]:
    """Yield the messages for each frame; an animal keeps its id by least motion.

    least (h, w) is the grey contrast of an animal, most the number of animals.
    """
    places = np.full((most, 2), 1e6)  # last place of each id
    for t, grey in frames:
        blobs = find_blobs(grey, background, least, most)
        away = np.linalg.norm(places[:, None] - blobs, axis=2)
        ids, found = linear_sum_assignment(away)
        places[ids] = blobs[found]
        yield [{"t": t, "id": int(i) + 1, "x": places[i, 0], "y": places[i, 1]} for i in ids]


@contextlib.contextmanager
def open_sender(address: str) -> Iterator[Callable[[str], object]]:
    """Yield a function that sends text to udp://host:port, or to a WebSocket."""
    if address.startswith("ws"):
        with connect(address, compression=None) as connection:
            yield connection.send
    else:
        parts = urlsplit(address)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
            yield lambda text: udp.sendto(text.encode(), (parts.hostname, parts.port))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", help="number of a camera, or a film file")
    parser.add_argument("--to", default="udp://127.0.0.1:9000")
    parser.add_argument("--animals", type=int, default=1, help="most animals")
    parser.add_argument("--contrast", type=int, default=20, help="grey levels from background")
    parser.add_argument("--box", type=int, nargs=4, default=[0, 0, 99999, 99999],
                        help="left, top, right, bottom of the arena, px")  # fmt: skip
    parser.add_argument("--token", help="by UDP, if finloop runs on another machine")
    options = parser.parse_args()
    film = cv2.VideoCapture(int(options.source) if options.source.isdecimal() else options.source)
    if not film.isOpened():
        parser.error(f"there is no camera or film {options.source}")
    ground = median_background(film)
    (left, top, right, bottom), least = options.box, np.full(ground.shape, 255)
    least[top:bottom, left:right] = options.contrast
    with open_sender(options.to) as send:
        for messages in track_animals(read_frames(film), ground, least, options.animals):
            if messages:
                messages[0] |= {"token": options.token} if options.token else {}
                send(json.dumps(messages))
