"""The exception whose message is for the user, and such messages for errors of the system."""

import errno
from pathlib import Path

FREE_SPACE = "free some space (`dvc gc --workspace --all-experiments` drops what nothing uses)"
"""What to do where a disk is full. Without --all-experiments, results of sweeps would go, too."""


_MOST_LETTERS = 4000  # of a part of a message


class FinloopError(Exception):
    """An error that the user can correct: it says what came, what was wanted and what to do.

    Stages print it as a single message and exit with status 1; any other exception is a bug.
    """

    def __init__(self, came: str, wanted: str, do: str) -> None:
        """Keep the parts of the message: what came, what was wanted, what the user can do.

        Each is cut to 4,000 letters, and letters that steer a terminal become question marks: parts
        of a message may come from a file of a stranger.
        """
        super().__init__(came, wanted, do)
        self.came, self.wanted, self.do = map(_make_printable, (came, wanted, do))

    def __str__(self) -> str:
        """Return the message, one line for each of its three parts."""
        return f"{self.came}\n  wanted: {self.wanted}\n  do:     {self.do}"


def _make_printable(text: str) -> str:
    """Return a text without letters that steer a terminal, cut where it is long."""
    if len(text) > _MOST_LETTERS:
        text = f"{text[:_MOST_LETTERS]} …"
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or letter in "\n\u00a0\u202f" else "?" for letter in text
    )


class UndecodableError(FinloopError):
    """The error that a frame of a clip cannot be decoded; later frames may be readable."""


MOVE_AWAY = "move it away, or name another place"
_SYSTEM_ERRORS: tuple[tuple[tuple[int, ...], str, str, str], ...] = (
    (
        (errno.ENOSPC, errno.EDQUOT),
        "the disk is full",
        "room for the whole output; no part of it was kept",
        f"{FREE_SPACE}, then give the same command again",
    ),
    (
        (errno.EFBIG,),
        "the file would be larger than the system allows",
        "no limit on the size of files; no part of this one was kept",
        "raise the limit (ulimit -f unlimited), or work on a disk that takes files above 4 GB",
    ),
    (
        (errno.EROFS, errno.EACCES, errno.EPERM),
        "",
        "a folder that can be read and written",
        "give yourself the right to (ls -ld, chmod), or work in a clone on another disk",
    ),
    (
        (errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENOTEMPTY, errno.ELOOP),
        "",
        "no file where a folder is wanted, no folder where a file is, no link that leads nowhere",
        MOVE_AWAY,
    ),
    (
        (errno.ENOENT,),
        "",
        "a file, folder or program of that name",
        "bring it back, or correct the name; what a stage has written comes back by: dvc repro",
    ),
    ((errno.ENAMETOOLONG,), "", "a name that the disk takes", "shorten it"),
    (
        (errno.EMFILE, errno.ENFILE),
        "",
        "some hundred open files",
        "raise the limit (ulimit -n 4096), or close other programs",
    ),
    (
        (errno.EIO, errno.ESTALE, errno.ENODEV, errno.ENXIO, errno.EXDEV),
        "",
        "a disk that can be read and written, as a whole",
        "bring the disk back and check it, or work in a clone on another disk",
    ),
)
"""Errors of the system: numbers, what came ("" = in the system's words), what was wanted, to do."""
_MEMORY_WORDS = (
    "annot allocate memory", "an't allocate memory", "can't start new thread",
    "failed to map segment", "nsufficient memory", "not enough memory", "out of memory",
)  # fmt: skip
"""In messages of OpenCV, PyTorch, threads and the loader of libraries where memory is lacking."""


def user_error(error: Exception, place: Path | None = None) -> FinloopError | None:
    """Return the message for an error that the user can remedy; None for any other error.

    place: the file or folder to name, instead of the one that the system names.
    """
    if isinstance(error, FinloopError):
        return error
    if _is_lack_of_memory(error):
        return FinloopError(
            f"out of memory ({error})" if str(error) else "out of memory",
            "memory for a few frames and the tables",
            "close other programs, raise a limit (ulimit -v unlimited), or take a clip with "
            "smaller frames",
        )
    if not isinstance(error, OSError):
        return None
    for numbers, came, wanted, do in _SYSTEM_ERRORS:
        if error.errno in numbers:
            name = place or error.filename2 or error.filename
            fault = came or str(error.strerror)
            return FinloopError(f"{name}: {fault}" if name else fault, wanted, do)
    return None


def _is_lack_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one that led to it, says that memory is lacking."""
    while error is not None:
        if isinstance(error, MemoryError) or any(words in str(error) for words in _MEMORY_WORDS):
            return True
        error = error.__cause__ or error.__context__
    return False
