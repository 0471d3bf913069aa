"""Every group of params.yaml at once: for the stage `params`, and for Hydra while it composes."""

from collections.abc import Mapping
from typing import Any

from stages.params import (
    STAMP,
    animate,
    bpn,
    check,
    clip,
    distance,
    export,
    extract,
    features,
    gait,
    gateways,
    loops,
    morph,
    render,
    report,
    sprites,
    tank,
)

GROUPS: dict[str, Mapping[str, type]] = {
    "clip": clip.OPTIONS,
    "extract": extract.OPTIONS,
    "features": features.OPTIONS,
    "bpn": bpn.OPTIONS,
    "sprites": sprites.OPTIONS,
    "distance": distance.OPTIONS,
    "loops": loops.OPTIONS,
    "gateways": gateways.OPTIONS,
    "animate": animate.OPTIONS,
    "render": render.OPTIONS,
    "tank": tank.OPTIONS,
    "export": export.OPTIONS,
    "morph": morph.OPTIONS,
    "gait": gait.OPTIONS,
    "report": report.OPTIONS,
}
"""conf/<word>/<option>.yaml holds the values of GROUPS[word][option]."""


def problems(values: Mapping[str, Any]) -> list[str]:
    """Everything that is wrong in a whole params.yaml, by dotted name."""
    found = [f"{word}: unknown" for word in values if word not in (*GROUPS, STAMP)]
    for word, options in GROUPS.items():
        found += check(word, options, values.get(word, {}))[1]
    return found
