"""Test whether a classifier can distinguish an animation from its film.

The animation is drawn and measured as the film was (`instrument`) and cut into windows (`windows`).
A classifier distinguishes them block by block (`classifier`, `compare`). Results are the area under
the ROC curve with its interval (`auc`) and the most obviously false windows (`examples`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "compare": ["FilmSample", "classify_windows"], "instrument": ["Instrument"],
})  # fmt: skip
