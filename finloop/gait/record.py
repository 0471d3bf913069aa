"""Fitted gaits as plain values, for JSON files: numbers only, no contours."""

import json
from dataclasses import asdict, fields
from typing import Any

from finloop.errors import FinloopError
from finloop.gait.model import SYMMETRIES, Gait

DECIMALS = 6
MOST = 1000.0  # of γ and the like: beyond ±1 a limb turns back, so more is a slip
MOST_BYTES = 1_000_000  # of a file
WANTED = "a gait as the stage `gait` writes it"
DO = "correct it after the example of data/gaits/, or fit one: dvc repro gait"
_KINDS: dict[str, type | tuple[type, ...]] = {
    "name": str, "symmetry": str, "frequency_hz": (int, float), "gamma": dict,
    "split": (int, float), "wavelet": str, "coarse": int, "support": dict, "source": str,
    "confidence": (int, float), "cycles": (int, float), "frames": int, "residuals": dict,
}  # fmt: skip
_NEEDED = ("name", "symmetry", "frequency_hz", "gamma")


def record_of(gait: Gait) -> dict[str, Any]:
    """A gait as plain values, its numbers to DECIMALS digits.

    Raises
    ------
    FinloopError
        If the gait is not one that `gait_of` would take.
    """
    content = json.loads(json.dumps(_rounded(asdict(gait))))
    if wrong := problems(content):
        raise FinloopError(_listed(wrong), WANTED, DO)
    return content


def gait_of(content: Any) -> Gait:
    """The gait that `record_of` described, or a person after its example.

    Raises
    ------
    ValueError
        If the content is no gait; all that is wrong is listed.
    """
    if wrong := problems(content):
        raise ValueError(_listed(wrong))
    gamma = {
        name: {sub: tuple(map(float, values)) for sub, values in of.items()}
        for name, of in content["gamma"].items()
    }
    support = {
        name: tuple((float(a), float(b)) for a, b in spans)
        for name, spans in content.get("support", {}).items()
    }
    return Gait(**(content | {"gamma": gamma, "support": support}))


def problems(content: Any) -> list[str]:
    """Everything that keeps decoded JSON from being a gait."""
    if not isinstance(content, dict):
        return ["it holds no gait but " + type(content).__name__]
    known = {field.name for field in fields(Gait)}
    wrong = [f"{key!r} is unknown" for key in content if key not in known]
    wrong += [f"{key!r} is missing" for key in _NEEDED if key not in content]
    for key in known & content.keys():
        value = content[key]
        if not isinstance(value, _KINDS[key]) or isinstance(value, bool):
            wrong.append(f"{key!r} is {value!r:.40}")
    if wrong:
        return sorted(wrong)
    if not content["name"]:
        wrong.append("'name' is empty")
    if content["symmetry"] not in SYMMETRIES:
        wrong.append(f"'symmetry' is {content['symmetry']!r}, not one of {', '.join(SYMMETRIES)}")
    coarse = content.get("coarse", 4)
    if not 1 <= coarse <= 2**16 or coarse & (coarse - 1):
        wrong.append(f"'coarse' is {coarse}, no power of two")
    for key, high in (("frequency_hz", 1000.0), ("split", 0.5)):
        if key in content and not 0 < content[key] < high:
            wrong.append(f"'{key}' is {content[key]!s:.20}, not between 0 and {high:g}")
    for key, most in (("confidence", 1.0), ("cycles", 1e12), ("frames", 2.0**53)):
        if key in content and not 0 <= content[key] <= most:
            wrong.append(f"'{key}' is {content[key]!s:.20}, not from 0 to {most:g}")
    for name, of in content["gamma"].items():
        if not isinstance(of, dict) or set(of) != {"A", "B"}:
            wrong.append(f"γ of {name!r} has not the two subcycles A and B")
        elif not all(isinstance(v, list) and v and all(map(_number, v)) for v in of.values()):
            wrong.append(
                f"γ of {name!r} is no list of numbers from {-MOST:g} to {MOST:g} in each subcycle"
            )
    for name, spans in content.get("support", {}).items():
        if not isinstance(spans, list) or not all(map(_span, spans)):
            wrong.append(f"the support of {name!r} is no list of [from, to], 0 ≤ from < to ≤ 2")
        elif _overlap(spans):
            wrong.append(f"the support of {name!r} has spans that overlap")
    if not content["gamma"]:
        wrong.append("'gamma' names no contour, nor '*' for all")
    if not all(map(_number, content.get("residuals", {}).values())):
        wrong.append("'residuals' are no numbers by name")
    return wrong


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MOST


def _span(span: Any) -> bool:
    if not (isinstance(span, list) and len(span) == 2 and all(map(_number, span))):
        return False
    return 0 <= span[0] < span[1] <= min(2, span[0] + 1)


def _overlap(spans: list[list[float]]) -> bool:
    """Whether a foot comes to the ground while it is there, the cycle after the last too."""
    ends = sorted(spans)
    following = [*ends[1:], *([a + 1, b + 1] for a, b in ends[:1])]
    return any(here[1] > there[0] for here, there in zip(ends, following, strict=True))


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return round(float(value), DECIMALS) + 0.0 if isinstance(value, float) else value


def _listed(wrong: list[str]) -> str:
    return "no gait: " + "; ".join(wrong[:8]) + " …" * (len(wrong) > 8)
