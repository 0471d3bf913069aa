"""CSV of any program, whatever its encoding, separator and decimal sign, as plain text."""

import codecs
import csv
import io
import re
from contextlib import suppress
from pathlib import Path

from finloop.base.errors import FinloopError

_MARKS = {  # byte-order marks
    codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16",
}  # fmt: skip
TEXTS = (".csv", ".tsv", ".txt")
"""Endings of such files."""

_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*")
_MOST_COLUMNS = 20_000
_HEADER_LINES = 4  # from which the separator is found


def read_plain_csv(path: Path) -> str:
    """Return the text of a CSV file with commas between cells and points in numbers.

    UTF-8 and UTF-16 with a mark, UTF-8 without and Windows-1252 are read; lines may end in any way;
    cells may be separated by comma, semicolon, tab or bar. The comma of a number is a decimal one:
    with commas between the cells, the number is quoted. Left out are lines without content, and
    what stands before the header: comments (#) and the separator as Excel names it (sep=).
    FinloopError for a file without text.
    """
    data = path.read_bytes()
    text = _decode(data)
    if text is None or "\0" in text:
        raise FinloopError(
            f"{path} cannot be read as text: it begins with {data[:16]!r}",
            "a CSV file",
            "export the tracks again as CSV; of a spreadsheet save the sheet as CSV",
        )
    text = text.lstrip("\ufeff")  # a second byte-order mark, of a file that was saved twice
    text = text.replace("\u00a0", " ")  # spreadsheets write spaces that do not break a line
    lines = [line for line in text.splitlines() if line.strip(",;\t| ")]
    while lines and lines[0].startswith(("#", "sep=")):
        del lines[0]
    text = "\n".join([*lines, ""])
    head = "\n".join(lines[:_HEADER_LINES])
    separator = max(",;\t|", key=head.count)
    if (columns := lines[0].count(separator) + 1 if lines else 0) > _MOST_COLUMNS:
        do = "export the tracks again as CSV"
        came = f"{path} has {columns} columns"
        raise FinloopError(came, f"a CSV file of at most {_MOST_COLUMNS:,} columns", do)
    if separator == "," and ", " not in head and '"' not in text:
        return text  # it is plain already
    rows = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    plain = io.StringIO()
    try:
        csv.writer(plain, lineterminator="\n").writerows(
            [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in row]
            for row in rows
        )
    except csv.Error as error:
        do = "export the tracks again as CSV"
        raise FinloopError(f"{path} cannot be read as CSV: {error}", "a CSV file", do) from error
    return plain.getvalue()


def _decode(data: bytes) -> str | None:
    """Decode bytes by their byte-order mark, else as UTF-8 or Windows-1252; None if that fails."""
    marked = [encoding for mark, encoding in _MARKS.items() if data.startswith(mark)]
    for encoding in marked or ["utf-8", "cp1252"]:
        with suppress(UnicodeDecodeError):
            return data.decode(encoding)
    return None


def first_lines(path: Path) -> str:
    """Return the first two lines of a CSV file, each cut to 80 characters, for a message."""
    lines = read_plain_csv(path).splitlines()[:2]
    return " / ".join(line[:80] + ("…" if len(line) > 80 else "") for line in lines)
