"""When the pictures of a folder or a TIFF were shot: times in their names and tags, in seconds."""

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import ExifTags, Image
from tifffile import TiffFile, TiffPage, xml2dict

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
    """Return the times [s after the earliest] (n,) in names such as 2024-05-03_12-30-01.250.

    A name gives a date with a time of day, or s, ms, µs or ns since 1970, such as 1714735801250.
    None if a name has no time, or the times are too few, equal or uneven: see `_plausible_times`.
    """
    return _plausible_times([_find_day_and_time(name) or _find_unix_time(name) for name in names])


def times_in_files(files: Iterable[Path]) -> Floats | None:
    """Return the times [s after the earliest] (n,) in tags of JPEG or TIFF: DateTime, SubSecTime.

    None if a file has none, or the times are too few, equal or uneven: see `_plausible_times`.
    """
    stamps = []
    for file in files:
        try:
            if file.suffix.lower().startswith(".tif"):
                with TiffFile(file) as tiff:
                    stamps.append(_find_tiff_time(tiff.pages.first))
            else:
                with Image.open(file, formats=["JPEG"]) as picture:
                    stamps.append(_find_exif_time(picture.getexif()))
        except Exception:  # damaged tags make both libraries raise anything
            return None
        if stamps[-1] is None:  # so that not all files of a folder without times are opened
            return None
    return _plausible_times(stamps)


def times_in_stack(stack: TiffFile, count: int) -> Floats | None:
    """Return the times [s after the earliest] (count,) of a stack's pages; None if unknown.

    They are the times that OME gives each page, else multiples of the step that OME or ImageJ
    gives, else those in the pages' tags, unless these are not plausible (`_plausible_times`).
    """
    facts = stack.imagej_metadata or {}
    step_s = float(facts.get("finterval") or 0) * _UNITS_S.get(str(facts.get("tunit", "s")), 0.0)
    if not step_s and facts.get("fps"):
        step_s = 1 / float(facts["fps"])
    if pixels := _read_ome_metadata(stack):
        seconds = _ome_page_times(pixels)
        if len(seconds) == count and (np.diff(seconds) > 0).all():
            return np.array(seconds) - seconds[0]
        unit_s = _UNITS_S.get(pixels.get("TimeIncrementUnit", "s"), 0.0)
        step_s = float(pixels.get("TimeIncrement", 0)) * unit_s or step_s
    if step_s > 0:
        return np.asarray(np.arange(count) * step_s)
    pages = [page for page in stack.pages if isinstance(page, TiffPage)]
    return _plausible_times([_find_tiff_time(page) for page in pages])


def _ome_page_times(pixels: dict[str, Any]) -> list[float]:
    """Return the times [s] of single pages in OME metadata, in order; NaN in unknown units.

    pixels: from `_read_ome_metadata`.
    """
    planes = pixels.get("Plane", [])
    planes = planes if isinstance(planes, list) else [planes]
    return [
        plane["DeltaT"] * _UNITS_S.get(plane.get("DeltaTUnit", "s"), np.nan)
        for plane in sorted(planes, key=lambda plane: plane.get("TheT", 0))
        if "DeltaT" in plane
    ]


def count_times(stack: TiffFile) -> int:
    """Return the number of time points of a TIFF stack by ImageJ or OME; 0 if neither tells."""
    frames = (
        (stack.imagej_metadata or {}).get("frames") or _read_ome_metadata(stack).get("SizeT") or 0
    )
    return int(frames)


def _read_ome_metadata(stack: TiffFile) -> dict[str, Any]:
    """Return the OME metadata of a stack's first series of pages; {} if it has none."""
    if not stack.ome_metadata:
        return {}
    image = xml2dict(stack.ome_metadata)["OME"]["Image"]
    pixels: dict[str, Any] = (image[0] if isinstance(image, list) else image)["Pixels"]
    return pixels


class Stamp(NamedTuple):
    """A time: its whole seconds since 1970, and the digits of its fraction of a second."""

    second: float  # whole seconds since 1970
    fraction: str  # digits after the whole seconds; "" if there are none


def _find_day_and_time(text: str) -> Stamp | None:
    """Return the first date with a time of day in a text as a `Stamp`; None if it has none."""
    for match in _DAY_AND_TIME.finditer(text):
        with suppress(ValueError):  # no such day or time: month 13, 25 o'clock
            year, month, day, hour, minute, second = map(int, match.groups()[:6])
            moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
            # Digits after a point, a comma or nothing are group 7; after a dash, group 8.
            return Stamp(moment.timestamp(), match[7] or match[8] or "")
    return None


def _find_unix_time(text: str) -> Stamp | None:
    """Return the first Unix time (s, ms, µs or ns since 1970) in a text; None if it has none."""
    for match in _SINCE_1970.finditer(text):
        if _FIRST_S <= int(match[1]) < _END_S:
            return Stamp(float(match[1]), match[2] or "")
    return None


def _find_exif_time(tags: Image.Exif) -> Stamp | None:
    """Return a JPEG's time from its Exif tags, that of its exposure if stated; None without."""
    exif = tags.get_ifd(ExifTags.IFD.Exif)
    original = exif.get(ExifTags.Base.DateTimeOriginal)
    moment = _find_day_and_time(str(original or tags.get(ExifTags.Base.DateTime)))
    digits = ExifTags.Base.SubsecTimeOriginal if original else ExifTags.Base.SubsecTime
    return moment and moment._replace(fraction=str(exif.get(digits) or "").strip(" \0"))


def _find_tiff_time(page: TiffPage) -> Stamp | None:
    """Return a TIFF page's time from its tags, that of its exposure if stated; None without."""
    exif = page.tags.valueof("ExifTag", {})
    moment = _find_day_and_time(str(exif.get("DateTimeOriginal", page.tags.valueof("DateTime"))))
    digits = str(exif.get("SubsecTimeOriginal") or exif.get("SubsecTime") or "").strip()
    return moment and moment._replace(fraction=moment.fraction or digits)


def _plausible_times(stamps: Sequence[Stamp | None]) -> Floats | None:
    """Return the times [s after the earliest] (n,) of stamps; None if they are not plausible.

    They are not if a stamp is None, there are fewer than two, two are at one time, all are in one
    second, or the median step, taken for all steps, gives less than half of the whole time: a
    counter that follows a date does not count parts of a second. The longest fraction sets the
    unit of all: if it has three digits, "7" and "250" are 7 and 250 ms.
    """
    known = [stamp for stamp in stamps if stamp is not None]
    if len(known) < max(2, len(stamps)):
        return None
    most_digits = max(len(stamp.fraction) for stamp in known)
    second = np.array([stamp.second for stamp in known])
    fraction_s = np.array([int(stamp.fraction or 0) / 10**most_digits for stamp in known])
    times = second - second[0] + fraction_s
    steps = np.diff(np.sort(times))
    usual_s = np.median(steps) * len(steps)  # how long the film is if all steps are usual
    if np.ptp(second) == 0 or steps.min() <= 0 or usual_s < float(np.ptp(times)) / 2:
        return None
    return np.asarray(times - times.min())
