"""The exception whose message is for the user."""


class FinloopError(Exception):
    """An error that the user can correct. It says what came, what was wanted and what to do.

    Stages print it as a single message and exit with status 1; any other exception is a bug.
    """

    def __init__(self, came: str, wanted: str, do: str) -> None:
        super().__init__(came, wanted, do)
        self.came, self.wanted, self.do = came, wanted, do

    def __str__(self) -> str:
        return f"{self.came}\n  wanted: {self.wanted}\n  do:     {self.do}"


class UndecodableError(FinloopError):
    """A frame of a clip cannot be decoded; frames from a later key frame on may be readable."""
