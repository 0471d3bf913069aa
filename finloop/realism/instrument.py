"""Drawn fish measured again by the film's own extraction: the same instrument for both.

An edit list is drawn on the empty tank as `render` draws it, without marks, at the film's size.
Each frame goes straight into the code of `extract` and `features`. Noise, threshold and typical
fish are the film's, because a clean drawing has no noise to measure. Only the region around the
fish is examined; elsewhere the frame equals the background. Frames are never coded: an animation
differs from its film in how the fish swims, not in compression.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask, Picture
from finloop.base.stretches import sample_stretches
from finloop.edit.schema import FRAME, filmed_edit_list
from finloop.extract.background import Scene
from finloop.extract.film import Detections, Detector, link_tracks, track_table_rows
from finloop.extract.samples import TypicalFish
from finloop.extract.segment import SegmentedFish
from finloop.extract.settings import ExtractSettings
from finloop.extract.table import SceneFacts
from finloop.features.settings import FeaturesSettings as FeatureSettings
from finloop.features.table import FEATURES, measure_features
from finloop.realism.crops import CropCamera, CropCollector, CropMeter, CropSeries, grey
from finloop.render.gallery import Gallery, fish_by_row
from finloop.render.living import LivingTank
from finloop.render.painter import Painter, PlacedFish

_RIM = 16  # px around a fish, beside its own size on each side


class EditList(NamedTuple):
    """An edit list (what is drawn at every tick), and its ticks at which another fish begins."""

    edit: pd.DataFrame
    cuts: Sequence[int] = ()


@dataclass(frozen=True)
class Instrument:
    """The noise, thresholds and typical fish of a film, to measure an animation in the same way.

    tank (h, w) or (h, w, 3) uint8: empty. arena (h, w) uint8: 255 inside. facts: noise, threshold
    and typical fish of the film. rate_hz: frames per second. fish_scale: drawn size / filmed size.
    """

    tank: Picture
    arena: Picture
    facts: SceneFacts
    extract: ExtractSettings
    features: FeatureSettings
    rate_hz: float
    fish_scale: float = 1.0

    def adapt_to_animation(self, fish_scale: float) -> "Instrument":
        """Return the instrument that measures fish drawn `fish_scale` times as large as filmed.

        It measures them in a tank of still water, shrunk so that they are as large as filmed.
        """
        still = replace(self.features, water_current_bl_s=0.0)
        adapted = replace(self, features=still, fish_scale=fish_scale)
        if fish_scale == 1:
            return adapted
        width, height = (max(1, round(side / fish_scale)) for side in self.arena.shape[::-1])
        return replace(
            adapted,
            tank=cv2.resize(self.tank, (width, height)),
            arena=cv2.resize(self.arena, (width, height), interpolation=cv2.INTER_NEAREST),
        )

    def reduce_to_filmed_size(self, edit: pd.DataFrame) -> pd.DataFrame:
        """Return an edit list scaled so that its fish are as large as filmed: itself, or a copy.

        Places shrink with the tank, towards its corner. Pixel centres lie at integers, so the
        corner is at −0.5 px.
        """
        if self.fish_scale == 1:
            return edit
        places = {name: (edit[name] + 0.5) / self.fish_scale - 0.5 for name in ("x_px", "y_px")}
        scales = {name: edit[name] / self.fish_scale for name in ("scale", "partner_scale")}
        return edit.assign(**places, **scales)

    @property
    def typical_fish(self) -> TypicalFish:
        """Return the film's typical fish, with which silhouettes are compared; it has no fins."""
        facts = self.facts
        fish = facts.typical_area_px, facts.typical_length_px, facts.typical_contrast_grey
        return TypicalFish(*fish, fins="none", thin=facts.thin, limbs=facts.limbs)

    @property
    def crop_camera(self) -> CropCamera:
        """Return the camera that cuts crops from frames of this tank."""
        facts = self.facts
        return CropCamera(
            grey(self.tank), facts.threshold_grey, facts.typical_length_px, facts.typical_area_px
        )

    def living_painter(self, tank: LivingTank | None) -> Painter:
        """Return a painter whose tank lives, unless fish are drawn smaller or larger than filmed.

        tank: the empty tank at every tick, as large as the film; None: it stands still.
        """
        return Painter(self.tank, tank=tank if self.fish_scale == 1 else None)

    def detect_fish(self, fish: Iterable[PlacedFish]) -> Iterator[Detections]:
        """Draw each fish on the empty tank; yield what extraction detects in that frame.

        Places in the result are px of the tank.
        """
        painter, facts = Painter(self.tank), self.facts
        for animal in fish:
            drawn = painter.show(animal)
            # The part of the tank around the fish: mostly tank, as the detector expects.
            margin = _RIM + max(drawn.bottom - drawn.top, drawn.right - drawn.left, 0)
            box = drawn.grow(margin).clip_to(self.tank.shape)
            scene = Scene(
                np.ascontiguousarray(self.tank[box.slices]), facts.polarity,  # type: ignore[arg-type]
                facts.noise_grey, facts.threshold_grey,
            )  # fmt: skip
            arena = np.ascontiguousarray(self.arena[box.slices])
            detector = Detector(arena, self.typical_fish, self.extract)
            frame = np.ascontiguousarray(painter.frame[box.slices])
            yield _shift_detections(detector.detect(frame, scene), box.left, box.top)

    def measure_fish(self, fish: Iterable[PlacedFish], cuts: Sequence[int] = ()) -> pd.DataFrame:
        """Return the feature table (FEATURES) of drawn fish, one per tick; `frame` is the tick.

        cuts: ticks at which another fish begins. The table is empty if extraction follows no fish.
        """
        pieces = link_tracks(self.detect_fish(fish), self.typical_fish, self.extract, cuts)
        fish_frames = [fish_frame for _, ready in pieces for fish_frame in ready]
        if not fish_frames:
            return FEATURES.empty()
        table = track_table_rows(fish_frames).sort_values(["track_id", "frame"], ignore_index=True)
        return measure_features(table, self.rate_hz, self.features)[0]


def _shift_detections(detections: Detections, x: int, y: int) -> Detections:
    """Convert detections from px of a part of the tank, whose corner is x, y, to px of the tank."""

    def shift_fish(fish: SegmentedFish) -> SegmentedFish:
        """Return a fish with all its places shifted by x, y px."""
        offset = np.array([x, y])
        return fish._replace(
            x_px=fish.x_px + x, y_px=fish.y_px + y, x0=fish.x0 + x, y0=fish.y0 + y,
            backbone=fish.backbone._replace(points_px=fish.backbone.points_px + offset),
            outline_px=fish.outline_px + offset,
        )  # fmt: skip

    spots = []
    for spot in detections.spots:
        left, top, right, bottom = spot.box
        box = left + x, top + y, right + x, bottom + y
        spots.append(replace(spot, x_px=spot.x_px + x, y_px=spot.y_px + y, box=box))
    fish_or_none = [None if fish is None else shift_fish(fish) for fish in detections.fish]
    return Detections(detections.verdicts, spots, fish_or_none)


@dataclass(frozen=True)
class Swimming:
    """What was measured of the fish drawn in one or several edit lists, n rows in all.

    table: columns of FEATURES, track numbers unique. list_number (n,): of the edit list, from 0.
    tick (n,): in that list. row (n,): of the film that is drawn, −1 for a sprite. time_s (n,):
    since the first tick of the first list; the lists follow each other without a gap. pictures:
    what is measured in crops of its pictures; None where only motion is compared.
    """

    table: pd.DataFrame
    list_number: Ints
    tick: Ints
    row: Ints
    time_s: Floats
    pictures: CropSeries | None = None


def join_measurements(
    edits: Sequence[pd.DataFrame], tables: Sequence[pd.DataFrame], rate_hz: float
) -> Swimming:
    """Join the measurements of several edit lists to one, as if played one after the other.

    Time runs on, and track numbers become unique. tables: one for each of `edits`; their column
    `frame` is the tick. rate_hz: ticks per second.
    """
    tables_so_far, rows, ticks_before, tracks_before = [], [], 0, 0
    for number, (edit, table) in enumerate(zip(edits, tables, strict=True)):
        tick = table["frame"].to_numpy(np.int64)
        row = np.where(edit["kind"] == FRAME, edit["source"].to_numpy(), -1)[tick]
        tables_so_far.append(table.assign(track_id=table["track_id"] + tracks_before))
        rows.append(np.stack([np.full_like(tick, number), tick, row, ticks_before + tick]))
        ticks_before += len(edit)
        tracks_before += int(table["track_id"].max()) + 1 if len(table) else 0
    joined = pd.concat(tables_so_far, ignore_index=True)[FEATURES.names]
    list_number, tick, row, tick_of_all = np.concatenate(rows, axis=1)
    return Swimming(joined, list_number, tick, row, tick_of_all / rate_hz)


def sample_film_lists(tracks: pd.DataFrame, longest: int, most: int, seed: int) -> list[EditList]:
    """Return random stretches of the film as edit lists, so that they are drawn like animations.

    tracks: track_id, x_px, y_px of every row. longest: most ticks of a stretch; stretches are put
    into a list until it has as many or more. most: about how many ticks all lists have together.
    The cuts of a list are the ticks at which its second and later stretches begin.
    """
    places = tracks[["x_px", "y_px"]].to_numpy()
    edit_lists: list[EditList] = []
    pieces: list[Ints] = []
    stretches = sample_stretches(tracks["track_id"].to_numpy(), longest, most, seed)
    for stretch in stretches:
        pieces.append(np.arange(stretch.start, stretch.stop))
        if sum(map(len, pieces)) >= longest or stretch is stretches[-1]:
            rows, cuts = np.concatenate(pieces), np.cumsum([len(piece) for piece in pieces])[:-1]
            edit_lists.append(EditList(filmed_edit_list(rows, places[rows]), cuts.tolist()))
            pieces = []
    return edit_lists


def measure_edit_list(
    open_pictures: Callable[[], AbstractContextManager[Gallery]],
    job: tuple[Instrument, EditList],
) -> pd.DataFrame:
    """Draw an edit list; return the feature table that extraction measures in its frames.

    job: how to measure, and the edit list; one argument, so that it can be sent to a process.
    """
    instrument, (edit, cuts) = job
    with open_pictures() as gallery:
        fish = fish_by_row(instrument.reduce_to_filmed_size(edit), gallery)
        return instrument.measure_fish(fish, cuts)


def measure_pictures(
    open_pictures: Callable[[], AbstractContextManager[Gallery]],
    open_tank: Callable[[], LivingTank | None],
    job: tuple[Instrument, EditList, pd.DataFrame, Mask],
) -> CropSeries:
    """Draw an edit list on the living tank; return what is measured in the crops of its fish.

    open_tank: returns the empty tank at every tick, or None if it stands still. job: how to draw,
    the edit list, its n measured ticks (columns of FEATURES, track by track), and the ticks (n,)
    whose crops are kept; one argument, so that it can be sent to a process.
    """
    instrument, (edit, _), table, keep = job
    collector, camera = CropCollector(len(table)), instrument.crop_camera
    rows_of_tick = table.groupby("frame").indices
    places = table[["x_px", "y_px", "heading_deg"]].to_numpy(float)
    track, meters = table["track_id"].to_numpy(), dict[int, CropMeter]()
    with open_pictures() as gallery:
        painter = instrument.living_painter(open_tank())
        for tick, fish in enumerate(fish_by_row(instrument.reduce_to_filmed_size(edit), gallery)):
            if tick in rows_of_tick:
                painter.show(fish, tick=tick)
            for row in rows_of_tick.get(tick, ()):
                meter = meters.setdefault(int(track[row]), CropMeter(camera))
                collector.add(row, meter.measure(painter.frame, *places[row]), bool(keep[row]))
    return collector.pictures()


def rows_to_keep(track_id: Ints, stride: int) -> Mask:
    """Return a mask (n,) of the rows whose crops are kept: one in `stride`, no track's first.

    track_id (n,): of each row, track by track.
    """
    tick = pd.Series(track_id).groupby(track_id, sort=False).cumcount().to_numpy()
    return (tick > 0) & (tick % stride == 1 % stride)
