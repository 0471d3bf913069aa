"""Can an animation be told from its film? It is measured again, and a classifier is asked.

Drawn and measured as the film was (`instrument`), cut into windows (`windows`), told apart block by
block (`classifier`, `compare`), with the area under the ROC curve and its interval (`auc`), and the
most obviously false windows (`examples`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "compare": ["Sample", "verdict"], "instrument": ["Instrument"],
})  # fmt: skip
