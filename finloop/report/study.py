"""The page of a study: several films, one row each, with the numbers that say how each went."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from finloop.report.page import render_template
from finloop.report.tables import format_number

THUMBNAIL_WIDTH_PX = 240


class StudyColumn(NamedTuple):
    """A column of the study's table: `<stage>.<number>`, heading, meaning and good direction."""

    key: str
    heading: str
    meaning: str
    good: str = ""


COLUMNS = (
    StudyColumn("clip.duration_s", "length (s)", "duration of the film"),
    StudyColumn("clip.frame_rate_hz", "frames/s", "frame rate of the film"),
    StudyColumn("film.findings", "findings",
                "faults found in the film, in its fish and in their headings", "0"),
    StudyColumn("identity.identities", "animals", "tracks, joined to animals where they touched"),
    StudyColumn("extract.tracks", "tracks", "tracks before they were joined"),
    StudyColumn("features.body_length_median_px", "length (px)", "median body length"),
    StudyColumn("features.headed_along_travel_pct", "heads ahead (%)",
                "moving animals that go where the head points: where it is low, heads may be tails",
                "high"),
    StudyColumn("loops.loops", "loops", "video loops (§4.1)"),
    StudyColumn("animate.hybrid_trials_film_pct", "hybrid: film (%)",
                "time for which mode hybrid plays film", "high"),
    StudyColumn("animate.hybrid_trials_goals_reached_pct", "hybrid: goals (%)",
                "random goals that mode hybrid reaches", "high"),
    StudyColumn("animate.matching_trials_goals_reached_pct", "matching: goals (%)",
                "random goals that mode matching reaches", "high"),
    StudyColumn("realism.hybrid_auc", "hybrid: AUC",
                "how well a classifier distinguishes the motion of mode hybrid from the film's",
                "as halves"),
    StudyColumn("realism.matching_auc", "matching: AUC", "the same for mode matching", "as halves"),
    StudyColumn("realism.halves_auc", "halves: AUC",
                "the same for two halves of the film itself: what the film cannot tell apart"),
    StudyColumn("realism.matching_picture_auc", "matching: picture AUC",
                "how well a classifier distinguishes the pictures of mode matching from the film's",
                "as halves"),
    StudyColumn("realism.halves_picture_auc", "halves: picture AUC",
                "the same for the pictures of two halves of the film itself"),
)  # fmt: skip


@dataclass(frozen=True)
class FilmResult:
    """What a study knows of one film: its settings, its numbers and pictures, or its error.

    name: of the film in the study. settings: those of this film alone, as overrides. numbers:
    `<stage>.<number>` → value. thumbnails: name → PNG or JPEG. report: link to its report, "" if
    there is none. error: why its run failed, "" if it did not.
    """

    name: str
    settings: Sequence[str]
    numbers: Mapping[str, float] = field(default_factory=dict)
    thumbnails: Mapping[str, bytes] = field(default_factory=dict)
    report: str = ""
    error: str = ""


def study_table(films: Sequence[FilmResult]) -> pd.DataFrame:
    """Return a table with a row for each film: numbers of COLUMNS, its error, its settings."""
    rows = {}
    for film in films:
        numbers = {column.key: film.numbers.get(column.key, np.nan) for column in COLUMNS}
        rows[film.name] = numbers | {"error": film.error, "settings": " ".join(film.settings)}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("film").reset_index()


def study_page(films: Sequence[FilmResult], common: Sequence[str]) -> str:
    """Return the page of a study as HTML text; its table can be sorted and filtered.

    common: the settings that all films share, as overrides.
    """
    rows = []
    for film in films:
        thumbnails = {
            name: b64encode(_make_thumbnail(picture)).decode()
            for name, picture in film.thumbnails.items()
        }
        values = [film.numbers.get(column.key) for column in COLUMNS]
        rows.append({"film": film, "values": values, "thumbnails": thumbnails})
    content = {"common": common, "rows": rows, "columns": COLUMNS, "number": format_number}
    return render_template("study.html.j2", content)


def _make_thumbnail(picture: bytes) -> bytes:
    """Return a PNG or JPEG picture reduced to a thumbnail, as a JPEG file's bytes."""
    whole = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    assert whole is not None, "not a picture"
    height = max(1, round(whole.shape[0] * THUMBNAIL_WIDTH_PX / whole.shape[1]))
    small = cv2.resize(whole, (THUMBNAIL_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
