"""All parameters that the planner of `matching` knows: its own, and those of every mode."""

from dataclasses import dataclass, fields

from finloop.animate.matching_settings import Settings as MatchingSettings
from finloop.animate.settings import Settings as CommonSettings


@dataclass(frozen=True)
class Settings(MatchingSettings, CommonSettings):
    """The groups `animate` and `matching` in one."""


def merge_settings(common: CommonSettings, own: MatchingSettings) -> Settings:
    """Return the parameters of both groups in one."""
    both = (common, own)
    return Settings(
        **{field.name: getattr(one, field.name) for one in both for field in fields(one)}
    )
