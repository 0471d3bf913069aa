"""A finding about a film: what is good about it, and what would be better filmed otherwise."""

from typing import NamedTuple

GOOD = "good"  # verdict
FINDINGS_NAME = "findings.csv"  # in the folders of the stages that judge the film


class Finding(NamedTuple):
    """One finding about a film: whether it is good, what was measured, and what to do if not."""

    word: str  # what it is about, such as `flicker`
    good: bool
    text: str  # a sentence
    remedy: str = ""  # a sentence, said only where the film is not good

    @property
    def terminal_line(self) -> str:
        """Return the finding as a line for a terminal."""
        return f"the film: {self.text}" if self.good else f"THE FILM: {self.text} {self.remedy}"

    @property
    def table_row(self) -> dict[str, str]:
        """Return the finding as a row of a table for people."""
        verdict, do = (GOOD, "") if self.good else ("better otherwise", self.remedy)
        return {"what": self.word, "verdict": verdict, "measured": self.text, "what to do": do}
