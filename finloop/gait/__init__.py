"""Gaits: motion fitted to film, and drawings driven by it (curve paper §4.2, Figs. 8-14).

From film to a cycle: contours in the body frame (`outline` for fish, `limbs` for walkers), the
period (`period`), the film sorted into a cycle (`cycles`). Fitting: key frames and γ (`fit`), the
error with and without γ (`compare`). Synthesis: the cycle from two key frames (`model`), another
drawing (`transfer`), feet on the ground (`ground`). `tool` is the command line.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "cycles": ["film_of_regions", "film_of_swim"], "fit": ["GaitContours", "Keys"],
    "model": ["Gait", "Layout", "at_phases", "four_keys", "gamma_fit"],
    "outline": ["track_outlines", "swim_contours"], "period": ["Period"],
})  # fmt: skip
