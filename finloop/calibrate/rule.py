"""The rule of a film's fish: zones, fitted where the film shows fish together, and own steps."""

from finloop.calibrate.film import LEAST, FilmShoal
from finloop.calibrate.fit import Fitted, default_zones, fit_zones
from finloop.calibrate.points import own_steps
from finloop.calibrate.settings import CalibrateSettings
from finloop.social.rule import Shoaling


def film_rule(film: FilmShoal, p: CalibrateSettings) -> tuple[Shoaling, Fitted | None]:
    """Return the rule of a film's fish, and the fit of its zones.

    The fit is None where the film shows too few fish together; then the zones are
    `default_zones`.
    """
    fit = fit_zones(film, p) if film.suffices_for_fit else None
    zones = fit.zones if fit else default_zones(p)
    steps = own_steps(film, film.whole_steps(p.rows), zones)
    return Shoaling(zones, steps, film.horizon, p.alike), fit


def shortage(film: FilmShoal) -> str:
    """Return in a sentence what a film lacks for a fit of zones; "" where it lacks nothing."""
    if film.suffices_for_fit:
        return ""
    first, second = (len(film.fit_rows(half, len(film.frame))) for half in (True, False))
    lack = (
        f"the halves of the film show a fish with others, and again {film.horizon} frames later, "
        f"{first} and {second} times; a fit takes {LEAST} each, so the zones are those of Couzin "
        "et al. (2002), or of the parameters"
    )
    if len(film.whole_steps(1)):
        return lack
    return f"{lack}; no track has three consecutive frames, so no fish can swim by them"
