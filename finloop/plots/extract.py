"""A picture of the silhouettes in some frames, to judge the settings of `extract`."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from finloop.base.arrays import Mask, Picture
from finloop.extract.background import Scene, match_scene_to_light
from finloop.extract.fins import Fins
from finloop.extract.samples import TypicalFish, Verdict, judge_silhouette
from finloop.extract.segment import Edge, Silhouette, SilhouetteEdge, find_silhouettes
from finloop.extract.settings import ExtractSettings
from finloop.plots.parts import Colour, convert_to_colour, join_in_rows, write_text

_COLOURS: dict[Verdict, Colour] = {  # RGB; colour-blind people distinguish them, too (Okabe-Ito)
    "fish": (0, 158, 115),
    "at border": (230, 159, 0),
    "too large": (213, 94, 0),
    "too small": (86, 180, 233),
    "too pale": (204, 121, 167),
}


def judge_silhouettes(
    frame: Picture, scene: Scene, typical: TypicalFish, arena: Picture, settings: ExtractSettings,
    fins: Fins = "none",
) -> Iterator[tuple[Silhouette, Verdict]]:  # fmt: skip
    """Yield the silhouettes of a frame (h, w[, 3]), each with the verdict on it.

    scene, typical: the background and a typical fish, as extraction measured them. arena (h, w):
    255 where animals can be. fins: which pale pixels belong to a silhouette.
    """
    lit_scene = match_scene_to_light(scene, frame)
    edge = SilhouetteEdge(settings.outline_contrast_ratio, settings.shadow, fins, typical.thin)
    for silhouette in find_silhouettes(frame, lit_scene, arena, settings.least_area_px, edge):
        yield silhouette, judge_silhouette(silhouette, typical, settings)


def trace_outlines(mask: Mask, corner: tuple[int, int]) -> Sequence[Edge]:
    """Return the outer outlines of a mask, in px of the frame; corner: x, y of its first pixel."""
    whole = mask.astype(np.uint8)
    return cv2.findContours(whole, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=corner)[0]


def draw_detections(
    frames: Sequence[Picture], labels: Sequence[str], scene: Scene, typical: TypicalFish,
    arena: Picture, settings: ExtractSettings,
) -> Picture:  # fmt: skip
    """Return a picture of frames, two per row, with an outline around each silhouette.

    The outline's colour is that of the verdict on the silhouette: "fish", or why it is none, such
    as "too small". labels: a text for each frame. scene, typical, arena: as in `judge_silhouettes`.
    The picture is RGB (h, w, 3), with a key on top. Texts and lines grow with the frames' width.
    """
    panels = []
    for frame, label in zip(frames, labels, strict=True):
        panel, scale = convert_to_colour(frame), frame.shape[1] / 900  # 1: a frame 900 px wide
        for silhouette, verdict in judge_silhouettes(frame, scene, typical, arena, settings):
            outlines = trace_outlines(silhouette.mask, (silhouette.x0, silhouette.y0))
            outline, stroke = max(outlines, key=len), max(1, frame.shape[1] // 600)
            cv2.drawContours(panel, [outline], -1, _COLOURS[verdict], stroke)
        place, stroke = (int(12 * scale), int(30 * scale)), max(1, round(2 * scale))
        write_text(panel, label, place, (255, 255, 255), font_scale=0.9 * scale, stroke_px=stroke)
        panels.append(panel)
    rows = join_in_rows(panels, columns=2)
    return np.vstack([_draw_key(rows[0].shape[1]), *rows])


def _draw_key(width: int) -> Picture:
    """Return a legend of the colours of all verdicts, `width` px wide."""
    scale = width / 1800
    key = np.full((int(50 * scale), width, 3), 255, np.uint8)
    for number, (verdict, colour) in enumerate(_COLOURS.items()):
        place = (int((20 + 300 * number) * scale), int(36 * scale))
        stroke = max(1, round(3 * scale))
        write_text(key, verdict, place, colour, font_scale=1.1 * scale, stroke_px=stroke)
    return key
