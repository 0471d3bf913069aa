"""The paper's integrators of Eq. 3.3 (§3.3), in the wavelet basis, where K is sparse.

Runge–Kutta on the first-order system (3.15); with ρ = 0, Euler's steps on C q̇ + K q = Q, C⁻¹ by
Schulz iteration or by sparse factors. `curve.dynamics.solve` calls them.
"""
