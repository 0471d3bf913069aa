"""Gaits: motion fitted to film, and drawings driven by it (curve paper §4.2, Figs. 8-14).

From film to a cycle: contours in the body frame (`outline` for fish, `limbs` for walkers), the
period (`period`), the film sorted into a cycle (`cycles`). Fitting: key frames and γ (`fit`), the
error with and without γ (`compare`). Synthesis: the cycle from two key frames (`model`), another
drawing (`transfer`), feet on the ground (`ground`). `tool` is the command line.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "cycles": ["swimmer_gait_contours", "walker_gait_contours"],
    "fit": ["GaitContours", "fit_gait"],
    "model": [
        "Gait", "HalfCycleLayout", "contours_at_phases", "four_key_frames", "gamma_from_fractions",
    ],
    "outline": ["track_outlines", "swim_contours"], "period": ["Period"],
})  # fmt: skip
