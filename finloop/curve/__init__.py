"""Curves as wavelet descriptors, their stiffness and dynamics (curve paper §2-3).

Polylines (`contour`), filters and transform (`wavelet`, §2), connection coefficients and K
(`stiffness`, §3.2), motion by it (`dynamics`, §3.1 and §3.3).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "dynamics": ["Material", "Problem", "Trajectory", "total_energy", "solve_motion"],
    "stiffness": ["connection_coefficients"],
    "wavelet": ["drop_details", "find_wavelet", "inverse_transform", "wavelet_transform"],
})  # fmt: skip
