"""The exception whose message is for the user."""

FREE_SPACE = "free some space (`dvc gc --workspace --all-experiments` drops what nothing uses)"
"""What to do where a disk is full. Without --all-experiments, results of sweeps would go, too."""


class FinloopError(Exception):
    """An error that the user can correct: it says what came, what was wanted and what to do.

    Stages print it as a single message and exit with status 1; any other exception is a bug.
    """

    def __init__(self, came: str, wanted: str, do: str) -> None:
        """Keep the parts of the message: what came, what was wanted, what the user can do."""
        super().__init__(came, wanted, do)
        self.came, self.wanted, self.do = came, wanted, do

    def __str__(self) -> str:
        """Return the message, one line for each of its three parts."""
        return f"{self.came}\n  wanted: {self.wanted}\n  do:     {self.do}"


class UndecodableError(FinloopError):
    """The error that a frame of a clip cannot be decoded; later frames may be readable."""
