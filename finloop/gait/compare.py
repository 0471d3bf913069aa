"""What γ buys, on frames left out of the fit (curve paper §4.2): beside the linear blend and more.

Clocks of a blend between two keys, from the stiffest to the freest: "linear", γ = 0; "gamma", one
γ a contour and subcycle; "gamma_scale", one γ a scale too; "free", any f that never turns back
(isotonic regression), one a contour and subcycle, which no parabola can beat but by its calm.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.optimize import isotonic_regression

from finloop.errors import FinloopError
from finloop.gait.descriptor import contour, per_coefficient
from finloop.gait.film import Filmed, Mask, check, samples_of
from finloop.gait.fit import (
    STILL,
    Moves,
    gammas_of,
    predicted,
    settled,
)
from finloop.gait.model import Points

CLOCKS = ("linear", "gamma", "gamma_scale", "free")
BUYS = 0.02
"""Share of a scale's left-out squared error that its γ must take away to count."""
SEEN = 1e-4
"""Share of a body length: a scale whose left-out error is smaller (RMS) is not seen at all."""


@dataclass(frozen=True)
class Comparison:
    """Errors on frames left out.

    Attributes
    ----------
    way
        How they were left out: "cycles", one at a time, or "every other frame".
    rms
        By clock: RMS distance of contours / body length.
    by_contour
        Columns contour, subcycle, frames, and rms_<clock>.
    by_scale
        Columns contour, subcycle, scale (0 = the approximation), coefficients, gamma (of all
        frames), energy_share (of the way between the keys), rms_linear, rms_gamma_scale,
        gamma_buys_pct (of the squared error), verdict.
    """

    way: str
    rms: dict[str, float]
    by_contour: pd.DataFrame
    by_scale: pd.DataFrame


def left_out(film: Filmed) -> tuple[str, list[Mask]]:
    """Which frames are left out in turn: whole cycles if there are two, else every other frame.

    A last cycle that is not whole is a turn of its own.
    """
    frames = np.arange(len(film.phase))
    # A frame that ends a cycle to rounding belongs to the next one.
    turn = np.floor(film.phase - film.phase[0] + 1e-9).astype(int)
    if film.cycles > 2 - 1e-6:
        return "cycles", [turn == one for one in np.unique(turn)]
    return "every other frame", [frames % 2 == one for one in range(2)]


def compare(
    film: Filmed, *, split: float = 0.25, wavelet: str = "coif2", coarse: int = 4
) -> Comparison:
    """Fit to some frames, predict the others, by each clock.

    Turns in which the frames that stay cannot be fitted are left out; if none is left, that is
    the error.

    Raises
    ------
    FinloopError
        As `gait.fit.fit`.
    """
    check(film)
    way, turns = left_out(film)
    rows, scale_rows = [], []
    problem: FinloopError | None = None
    for out in turns:
        try:
            found = list(_turn(film, out, split, wavelet, coarse))
        except FinloopError as error:
            problem = error
            continue
        for one, two in found:
            rows.append(one)
            scale_rows += two
    if not rows and problem is not None:
        raise problem
    _, moves = settled(film, split, wavelet, coarse)
    contours = pd.DataFrame(rows).groupby(["contour", "subcycle"], sort=False).sum()
    total = contours.sum()
    rms = {c: float(np.sqrt(total[c] / total["frames"])) / film.body_length for c in CLOCKS}
    for c in CLOCKS:
        contours[f"rms_{c}"] = np.sqrt(contours.pop(c) / contours["frames"]) / film.body_length
    return Comparison(
        way, rms, contours.reset_index(), _scales(film, pd.DataFrame(scale_rows), moves)
    )


def _turn(
    film: Filmed, out: Mask, split: float, wavelet: str, coarse: int
) -> Iterator[tuple[dict, list[dict]]]:
    """Of one turn: a row per contour and subcycle of squared errors, and its rows of scales."""
    still = STILL * film.body_length
    stay = replace(
        film, phase=film.phase[~out], contours={k: v[~out] for k, v in film.contours.items()}
    )
    gone = replace(
        film, phase=film.phase[out], contours={k: v[out] for k, v in film.contours.items()}
    )
    _, moves = settled(stay, split, wavelet, coarse)
    per_limb, per_scale = (gammas_of(moves, per, still) for per in (False, True))
    tests = samples_of(gone, split, wavelet, coarse)
    for (name, sub), one in moves.items():
        test = tests[name][sub]
        if not len(test.tau):
            continue
        size = len(one.to)
        letter = "AB"[sub]
        spread = per_coefficient(per_scale[name][letter], size, coarse)
        errors = {
            "linear": test.coefficients - predicted(one, test.tau, np.zeros(1)),
            "gamma": test.coefficients - predicted(one, test.tau, np.array(per_limb[name][letter])),
            "gamma_scale": test.coefficients - predicted(one, test.tau, spread),
            "free": test.coefficients
            - (one.to + free(one, test.tau)[:, None, None] * (one.source - one.to)),
        }
        row = {"contour": name, "subcycle": letter, "frames": len(test.tau)}
        for clock_name, error in errors.items():
            off = contour(error, size, wavelet, coarse)
            row[clock_name] = float((off**2).sum()) / size
        yield (
            row,
            [
                {
                    "contour": name,
                    "subcycle": letter,
                    "scale": m,
                    "frames": len(test.tau),
                    "linear": float((errors["linear"][:, where] ** 2).sum()) / size,
                    "gamma_scale": float((errors["gamma_scale"][:, where] ** 2).sum()) / size,
                }
                for m, where in enumerate(one.scales)
            ],
        )


def free(one: Moves, tau: Points) -> Points:
    """f at tau of the free monotone timing: isotonic least squares, 1 at 0 and 0 at 1."""
    way = (one.source - one.to).ravel()
    norm = float(way @ way)
    if norm == 0 or not len(one.samples.tau):
        return 1 - tau
    order = np.argsort(one.samples.tau, kind="stable")
    flat = (one.samples.coefficients - one.to).reshape(len(order), -1)
    falling = isotonic_regression(flat[order] @ way / norm, increasing=False).x
    at = np.concatenate([[0.0], one.samples.tau[order], [1.0]])
    return np.interp(tau, at, np.concatenate([[1.0], np.clip(falling, 0, 1), [0.0]]))


def _scales(film: Filmed, rows: pd.DataFrame, moves: dict[tuple[str, int], Moves]) -> pd.DataFrame:
    keys = ["contour", "subcycle", "scale"]
    table = rows.groupby(keys, sort=False).sum().reset_index()
    gammas, share, count = [], [], []
    for name, letter, m in table[keys].itertuples(index=False):
        one = moves[name, "AB".index(letter)]
        way = one.source - one.to
        gammas.append(one.gammas(True, STILL * film.body_length)[m])
        share.append(float((way[one.scales[m]] ** 2).sum() / max((way**2).sum(), 1e-300)))
        count.append(one.scales[m].stop - one.scales[m].start)
    was, now = table.pop("linear"), table.pop("gamma_scale")
    frames = table.pop("frames")
    rms = {
        "rms_linear": np.sqrt(was / frames) / film.body_length,
        "rms_gamma_scale": np.sqrt(now / frames) / film.body_length,
    }
    bought = (was - now) / was.where(was > 0)
    unseen = rms["rms_linear"] < SEEN
    verdict = np.select(
        [unseen, bought > BUYS, bought < -BUYS], ["not seen", "buys", "costs"], "buys nothing"
    )
    return table.assign(
        coefficients=count,
        gamma=gammas,
        energy_share=share,
        **rms,
        gamma_buys_pct=(100 * bought).fillna(0.0),
        verdict=verdict,
    )
