"""When the pictures of a folder or a TIFF were shot: times in their names and tags, in seconds."""

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from PIL import ExifTags, Image
from tifffile import TiffFile, TiffFileError, TiffPage, xml2dict

from finloop.base.arrays import Floats

_DAY_AND_TIME = re.compile(
    r"(?<!\d)(\d{4})[-_.:]?(\d\d)[-_.:]?(\d\d)[-_. T]?(\d\d)[-_.:h]?(\d\d)[-_.:m]?(\d\d)"
    r"(?:[.,]?(\d{1,9})|[-_s](\d{3}|\d{6}))?(?!\d)"
)
_SINCE_1970 = re.compile(r"(?<!\d)(\d{10})(?:\.?(\d{3}|\d{6}|\d{9}))?(?!\d)")
# Seconds since 1970 that are taken for a time: those of the years 2000 to 2099.
_FIRST_S, _END_S = (datetime(year, 1, 1, tzinfo=UTC).timestamp() for year in (2000, 2100))
_UNITS_S = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "min": 60.0, "sec": 1.0, "msec": 1e-3}


def times_in_names(names: Sequence[str]) -> Floats | None:
    """Return the times [s] (n,) in names such as 2024-05-03_12-30-01.250 and 1714735801250.

    Known are a date with a time of day, and the seconds, or parts of one, since 1970. None if a
    name has no time, or the times cannot be those of a film.
    """
    stamps = [_find_day_and_time(name) or _find_since_1970(name) for name in names]
    return _to_times(stamps)


def times_in_files(files: Iterable[Path]) -> Floats | None:
    """Return the times [s] (n,) in the tags of JPEG or TIFF files: DateTime, with SubSecTime.

    None if a file has none, or the times cannot be those of a film.
    """
    stamps = []
    for file in files:
        try:
            if file.suffix.lower().startswith(".tif"):
                with TiffFile(file) as tiff:
                    stamps.append(_find_tag(tiff.pages.first))
            else:
                with Image.open(file) as picture:
                    stamps.append(_find_exif_time(picture.getexif()))
        except (TiffFileError, OSError):
            return None
        if stamps[-1] is None:
            return None
    return _to_times(stamps)


def times_in_stack(stack: TiffFile, count: int) -> Floats | None:
    """Return the times [s] (count,) of a stack's pages, by ImageJ, OME or tags; None: unknown.

    They are the times that OME gives each page, else multiples of the step that OME or ImageJ
    gives, else those in the pages' tags.
    """
    facts = stack.imagej_metadata or {}
    step_s = float(facts.get("finterval") or 0) * _UNITS_S.get(str(facts.get("tunit", "s")), 0.0)
    if not step_s and facts.get("fps"):
        step_s = 1 / float(facts["fps"])
    if pixels := _ome_pixels(stack):
        seconds = _ome_page_times(pixels)
        if len(seconds) == count and (np.diff(seconds) > 0).all():
            return np.array(seconds) - seconds[0]
        unit_s = _UNITS_S.get(pixels.get("TimeIncrementUnit", "s"), 0.0)
        step_s = float(pixels.get("TimeIncrement", 0)) * unit_s or step_s
    if step_s > 0:
        return np.asarray(np.arange(count) * step_s)
    return _to_times([_find_tag(page) for page in stack.pages if isinstance(page, TiffPage)])


def _ome_page_times(pixels: dict[str, Any]) -> list[float]:
    """Return the times [s] that OME gives single pages, in their order; NaN in unknown units.

    pixels: from `_ome_pixels`.
    """
    planes = pixels.get("Plane", [])
    planes = planes if isinstance(planes, list) else [planes]
    return [
        plane["DeltaT"] * _UNITS_S.get(plane.get("DeltaTUnit", "s"), np.nan)
        for plane in sorted(planes, key=lambda plane: plane.get("TheT", 0))
        if "DeltaT" in plane
    ]


def count_times(stack: TiffFile) -> int:
    """Return at how many times the pages of a stack were shot, by ImageJ or OME; 0: unknown."""
    frames = (stack.imagej_metadata or {}).get("frames") or _ome_pixels(stack).get("SizeT") or 0
    return int(frames)


def _ome_pixels(stack: TiffFile) -> dict[str, Any]:
    """Return what OME says of a stack's first series of pages; {} if it says nothing."""
    if not stack.ome_metadata:
        return {}
    image = xml2dict(stack.ome_metadata)["OME"]["Image"]
    pixels: dict[str, Any] = (image[0] if isinstance(image, list) else image)["Pixels"]
    return pixels


Stamp = tuple[float, str]
"""Whole seconds since 1970, and the digits of a part of a second, "" if there are none."""


def _find_day_and_time(text: str) -> Stamp | None:
    """Return the first date with a time of day in a text as a stamp; None if it has none.

    A stamp is whole seconds since 1970, and the digits of the part of a second, "" if none.
    """
    for match in _DAY_AND_TIME.finditer(text):
        with suppress(ValueError):  # no such day or time: month 13, 25 o'clock
            year, month, day, hour, minute, second = map(int, match.groups()[:6])
            moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
            # The digits follow a point or comma, or nothing (7); or a dash (8).
            return moment.timestamp(), match[7] or match[8] or ""
    return None


def _find_since_1970(text: str) -> Stamp | None:
    """Return the time in a text that counts s, ms, µs or ns since 1970; None if it has none.

    It is whole seconds, and the digits of the part of a second, "" if none.
    """
    for match in _SINCE_1970.finditer(text):
        if _FIRST_S <= int(match[1]) < _END_S:
            return float(match[1]), match[2] or ""
    return None


def _find_exif_time(tags: Image.Exif) -> Stamp | None:
    """Return the time in the Exif tags of a JPEG, of its exposure if stated; None without one.

    It is whole seconds since 1970, and the digits of the part of a second, "" if none.
    """
    exif = tags.get_ifd(ExifTags.IFD.Exif)
    original = exif.get(ExifTags.Base.DateTimeOriginal)
    moment = _find_day_and_time(str(original or tags.get(ExifTags.Base.DateTime)))
    subsecond = ExifTags.Base.SubsecTimeOriginal if original else ExifTags.Base.SubsecTime
    return (moment[0], str(exif.get(subsecond) or "").strip(" \0")) if moment else None


def _find_tag(page: TiffPage) -> Stamp | None:
    """Return the time in the tags of a TIFF page; None if there is none.

    It is whole seconds since 1970, and the digits of the part of a second, "" if none.
    """
    exif = page.tags.valueof("ExifTag", {})
    moment = _find_day_and_time(str(exif.get("DateTimeOriginal", page.tags.valueof("DateTime"))))
    parts = str(exif.get("SubsecTimeOriginal") or exif.get("SubsecTime") or "").strip()
    return (moment[0], moment[1] or parts) if moment else None


def _to_times(stamps: Sequence[Stamp | None]) -> Floats | None:
    """Return the times [s] (n,) of stamps, from the earliest; None if they cannot be of a film.

    A stamp is whole seconds, and the digits of the part of a second. The longest digits set their
    unit: if they are three, "7" and "250" are 7 and 250 ms. A film has two stamps or more, lasts
    into another second, and shows no two pictures at one time. Its usual steps make up at least
    half of its time: a counter that follows a date does not count parts of a second.
    """
    known = [stamp for stamp in stamps if stamp is not None]
    if len(known) < max(2, len(stamps)):
        return None
    most_digits = max(len(digits) for _, digits in known)
    second = np.array([second for second, _ in known])
    fraction = np.array([int(digits or 0) / 10**most_digits for _, digits in known])
    times = second - second[0] + fraction
    steps = np.diff(np.sort(times))
    usual_s = np.median(steps) * len(steps)  # how long the film is if all steps are usual
    if np.ptp(second) == 0 or steps.min() <= 0 or usual_s < float(np.ptp(times)) / 2:
        return None
    return np.asarray(times - times.min())
