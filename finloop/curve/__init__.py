"""Curves as wavelet descriptors, their stiffness and dynamics (curve paper §2-3).

Filters (`filters`, Eqs. 2.1-2.2), the transform (`wavelet`, Eqs. 2.3-2.12), connection coefficients
and K (`stiffness`, §3.2), motion by it (`problem`, `dynamics`, `integrate`, `oscillator`, §3.1 and
§3.3).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "dynamics": ["energy", "solve"], "filters": ["filter_bank"],
    "problem": ["Material", "Trajectory", "Problem"], "stiffness": ["connection"],
    "wavelet": ["inverse_transform", "wavelet_transform", "drop_details"],
})  # fmt: skip
