"""The most obviously false windows of an animation, each beside the most similar film window."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Picture
from finloop.base.schema import Column, Schema
from finloop.edit.schema import EDIT
from finloop.realism.compare import FilmSample, Sides, Verdict
from finloop.realism.crops import cut_square
from finloop.realism.instrument import EditList, Swimming
from finloop.realism.windows import CHANNELS, WindowCut, Windows
from finloop.render.gallery import Gallery, fish_by_row
from finloop.render.marks import write_text
from finloop.render.painter import Painter

ANIMATION, FILM = SIDES = ("animation", "film")
EXAMPLES = Schema(
    Column("example", "int32", "1"),
    Column("compared", "string", "1"),
    Column("side", "string", "1"),
    Column("score", "float64", "1"),
    Column("start_deg", "float64", "deg"),
    *EDIT.columns,
)
"""Windows as edit lists. compared: the mode; side: one of `SIDES`; score: how false the animation
looks; start_deg: the first heading of the window."""

CURVES = Schema(
    Column("example", "int32", "1"),
    Column("side", "string", "1"),
    Column("time_s", "float64", "s"),
    *(Column(name, "float64", "see CHANNELS") for name in CHANNELS),
)
"""The channels of the examples: the classifier's input."""

WORDS_PX = 28
"""Height of the title above an example's film."""
_AROUND_BL = 1.5  # body lengths that a picture shows beyond the path


class WindowPair(NamedTuple):
    """An animation window and the film window most similar to it, each by its index.

    score: held-out score of the animation window; higher is more obviously false.
    """

    animation: int
    film: int
    score: float


def most_false_windows(
    film: Windows, animation: Windows, score: Floats, count: int, length: int
) -> list[WindowPair]:
    """Return the animation windows with the highest scores, each with the most similar film window.

    No two animation windows touch. score (n,): held-out, NaN where there is none. length: rows of a
    window. The most similar window has the least sum of squared differences of the channels, in the
    film's standard deviations.
    """
    deviations = film.x.std(axis=(0, 1)) + 1e-9
    pairs: list[WindowPair] = []
    for number in np.argsort(-np.nan_to_num(score, nan=-np.inf), kind="stable").tolist():
        if len(pairs) == count or np.isnan(score[number]):
            break
        taken_rows = animation.first[[pair.animation for pair in pairs]]
        if (np.abs(animation.first[number] - taken_rows) > length).all():
            differences = (((film.x - animation.x[number]) / deviations) ** 2).sum(axis=(1, 2))
            pairs.append(WindowPair(number, int(differences.argmin()), float(score[number])))
    return pairs


def find_examples(
    sample: FilmSample, edit_lists: Mapping[str, Sequence[EditList]],
    measured: Mapping[str, Swimming], sides: Sides, verdicts: Mapping[str, Verdict],
) -> tuple[pd.DataFrame, pd.DataFrame]:  # fmt: skip
    """Return the most obviously false windows of all modes as tables `EXAMPLES` and `CURVES`.

    Each stands beside the film window most like it. edit_lists, measured: the edit lists, and the
    swimming that extraction measured in them, by mode, and by FILM for the film. sides, verdicts:
    windows and results by the name of the comparison; only modes give examples. The tables are
    empty if there are none.
    """
    cut, numbers = sample.window_cut, count()
    time_s = (np.arange(cut.length // cut.step) + 0.5) * (cut.step / sample.rate_hz)
    edits, curves = list[pd.DataFrame](), list[pd.DataFrame]()
    for mode in (name for name in verdicts if name in measured):
        film, animation = sides[mode]
        score = verdicts[mode].scores.score[len(film) :]  # the film's windows come first
        for pair in most_false_windows(film, animation, score, sample.p.examples, cut.length):
            example = next(numbers)
            for side, name, windows, window in (
                (ANIMATION, mode, animation, pair.animation), (FILM, FILM, film, pair.film),
            ):  # fmt: skip
                edit = _window_edit_list(
                    edit_lists[name], measured[name], windows.first[window], cut
                )
                edit = edit.assign(example=example, side=side, compared=mode, score=pair.score)
                edits.append(edit)
                channels = pd.DataFrame(windows.x[window].astype(float), columns=list(CHANNELS))
                curves.append(channels.assign(example=example, side=side, time_s=time_s))
    if not edits:
        return EXAMPLES.empty(), CURVES.empty()
    examples, channels = (pd.concat(parts, ignore_index=True) for parts in (edits, curves))
    return examples[EXAMPLES.names], channels[CURVES.names]


def _window_edit_list(
    edit_lists: Sequence[EditList], measured: Swimming, first_row: int, cut: WindowCut
) -> pd.DataFrame:
    """Return the rows of an edit list that one window shows, with its first heading as start_deg.

    The window has `cut.length` steps, and so a tick more. edit_lists: one for each fish; measured:
    their swimming, joined; first_row: the window's, in it.
    """
    rows = first_row + np.arange(cut.length + 1)
    edit = edit_lists[int(measured.list_number[first_row])].edit.iloc[measured.tick[rows]]
    return edit.assign(start_deg=float(measured.table["heading_deg"].iloc[first_row]))


class CameraView(NamedTuple):
    """A square view of the tank: centre x, y and width in px, and the heading that points right.

    heading_deg: in degrees, anticlockwise.
    """

    x_px: float
    y_px: float
    heading_deg: float
    width_px: float

    def crop_frame(self, frame: Picture, size_px: int) -> Picture:
        """Crop a frame (h, w) or (h, w, 3) to this view: a picture (size_px, size_px, 3).

        It is turned so that `heading_deg` points to the right.
        """
        centre, scale = (self.x_px, self.y_px), size_px / self.width_px
        picture = cut_square(frame, centre, self.heading_deg, scale, size_px)
        return picture if picture.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB)


def _fixed_views(example: pd.DataFrame, length_px: float) -> dict[str, CameraView]:
    """Return the view of the tank for each side of an example, animation and film, by its name.

    Each shows the whole path of its fish, and both are equally wide in body lengths of their fish.
    length_px: body length as filmed.
    """
    sides = example.groupby("side")
    low, high = sides[["x_px", "y_px"]].min(), sides[["x_px", "y_px"]].max()
    scale = sides["scale"].median()  # drawn size / filmed size
    path_sizes = np.hypot(*(high - low).to_numpy().T) / scale.to_numpy()  # for fish as filmed
    width = float(path_sizes.max()) + _AROUND_BL * length_px
    start_deg, middle = sides["start_deg"].first(), (low + high) / 2
    return {
        side: CameraView(
            middle.at[side, "x_px"], middle.at[side, "y_px"], float(start_deg[side]),
            width * float(scale[side]),
        )
        for side in middle.index
    }  # fmt: skip


def draw_strip(
    edit: pd.DataFrame, gallery: Gallery, painter: Painter, length_px: float, count: int,
    size_px: int,
) -> Picture:  # fmt: skip
    """Return `count` pictures of a fish side by side, spread over some ticks of an edit list.

    edit: the ticks, with the column start_deg, the heading that points right in the pictures.
    length_px: body length as filmed. The result is (size_px, count × size_px, 3).
    """
    moments = edit.iloc[np.linspace(0, len(edit) - 1, count).round().astype(int)]
    numbered = moments.assign(tick=np.arange(count))
    tiles, width = list[Picture](), _AROUND_BL * length_px * float(moments["scale"].median())
    for fish, start in zip(fish_by_row(numbered, gallery), moments["start_deg"], strict=True):
        painter.show(fish)
        view = CameraView(fish.x_px, fish.y_px, start, width)
        tiles.append(view.crop_frame(painter.frame, size_px))
    return np.hstack(tiles)


def draw_example(
    example: pd.DataFrame, gallery: Gallery, tank: Picture, length_px: float, size_px: int
) -> Iterator[Picture]:
    """Yield the frames of an example's film: animation left, film right, titles above.

    length_px: body length as filmed. size_px: width of each side. Frames are (size_px + WORDS_PX, 2
    size_px, 3).
    """
    views, first = _fixed_views(example, length_px), example.iloc[0]

    def side_frames(side: str) -> Iterator[Picture]:
        """Yield the pictures (size_px, size_px, 3) of one side, "animation" or "film"."""
        edit, painter = example[example["side"] == side], Painter(tank)
        for fish in fish_by_row(edit.assign(tick=np.arange(len(edit))), gallery):
            painter.show(fish)
            yield views[side].crop_frame(painter.frame, size_px)

    titles = (
        f"{first['compared']} {first['example'] + 1}: animation",
        "the film window most like it",
    )
    for pair in zip(*map(side_frames, SIDES), strict=True):
        frame = np.full((size_px + WORDS_PX, 2 * size_px, 3), 255, np.uint8)
        for number, (picture, text) in enumerate(zip(pair, titles, strict=True)):
            frame[WORDS_PX:, number * size_px : (number + 1) * size_px] = picture
            write_text(frame, text, (number * size_px + 8, WORDS_PX - 9), (0, 0, 0), WORDS_PX // 2)
        yield frame


def draw_crop_pair(title: str, crops: Picture, enlarged: int) -> Iterator[Picture]:
    """Yield the frames of a film of crops: animation left, film right, titles above.

    crops (2, n, size, size): of animation and film, in n ticks. enlarged: how often a pixel is
    repeated. Frames are (enlarged size + WORDS_PX, 2 enlarged size, 3).
    """
    width = enlarged * crops.shape[-1]
    titles = f"{title}: animation", "the film most like it"
    for animation, film in zip(*crops, strict=True):
        frame = np.full((width + WORDS_PX, 2 * width, 3), 255, np.uint8)
        frame[WORDS_PX:] = (
            np.hstack([animation, film]).repeat(enlarged, 0).repeat(enlarged, 1)[..., None]
        )
        for number, text in enumerate(titles):
            write_text(frame, text, (number * width + 8, WORDS_PX - 9), (0, 0, 0), WORDS_PX // 2)
        yield frame
