"""Compute a curve's stiffness in wavelet bases (§3.2, Eqs. 3.3–3.14; Tables 1, 2; Fig. 3).

Glossary: μ_l, ν_l = ∫ φ'(x − l) φ'(x), ∫ ψ'(x − l) ψ'(x), the *connection coefficients*; *n*
functions round the curve, a power of two; e₀ *elastic*, ρ *density*, s₁, s₂ damping (Eq. 3.5).

The curve's parameter runs from 0 to 1 (§2.2), so the n functions are φ(n x − k) √n and
K = e₀ n² μ. Its low eigenvalues tend to e₀ (2πk)² as n grows, for every wavelet. A point of a
curve is its coefficient times √n, the same factor for all, so M, C, K act on points unchanged.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.sparse import csr_array

from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError
from finloop.curve.wavelet import (
    count_halvings,
    find_wavelet,
    inverse_transform,
    scale_slices,
    wavelet_for_transform,
    wavelet_transform,
)

_ALMOST = 1e-6  # an eigenvalue this near a bound lies on it: tabled filters are rounded


@dataclass(frozen=True)
class ConnectionCoefficients:
    """Connection coefficients of a wavelet: integrals of products of derivatives (§3.2).

    mu, nu (P,): of two scaling functions, and of two wavelets, l = 0 … P − 1 apart; the sign of l
    does not matter. They are not normalised: Tables 1 and 2 print `mu / mu[0]` and `nu / nu[0]`.
    `autocorrelation` (P + 1,) is α_n = 2 Σ h_i h_{i+n} of the low filter h.
    """

    autocorrelation: Floats
    mu: Floats
    nu: Floats


@cache
def connection_coefficients(wavelet: str) -> ConnectionCoefficients:
    """Return the connection coefficients of a wavelet, kept for later calls (Eqs. 3.11, 3.14).

    μ is the null vector of Eq. 3.11, scaled by Σ l² μ_l = −2: ∫ φ'' x² = 2, integrated by parts,
    after Beylkin. ν follows by Eq. 3.14, which holds for l = 0 too: ν₀ = 7 μ₀. FinloopError if the
    wavelet is not orthogonal, or the derivative of φ is not square integrable (φ is not in H¹):
    then μ is infinite, though (3.11) may have a solution.
    """
    filters = find_wavelet(wavelet)
    low = np.array(filters.rec_lo)  # h of Eq. 2.1
    taps = len(low)
    if not filters.orthogonal:
        raise FinloopError(
            f"the wavelet {wavelet} is not orthogonal",
            "an orthogonal wavelet: only then is the mass matrix M = ρI",
            "take an orthogonal one, such as db4, coif2 or sym8",
        )
    alpha = 2 * np.correlate(low, low, "full")[taps - 1 :]
    smooth = _sobolev_smoothness(alpha)
    if smooth <= 1:
        raise FinloopError(
            f"φ of the wavelet {wavelet} lies in H^s for s < {smooth:.2f} only: its derivative is "
            "not square integrable, so its stiffness is infinite",
            "a wavelet with φ in H¹",
            "use a smoother wavelet: db3 or longer, coif1, sym4, …",
        )
    # Eq. 3.11, μ = 4 T μ, for l ≥ 0 alone: as μ_l = μ_{−l}, columns −l are added to columns l.
    count = taps - 1  # μ_l is 0 beyond the support
    transfer = _refinement_matrix(alpha, count)  # row and column count − 1 are l = 0
    folded = transfer[count - 1 :, count - 1 :].copy()
    folded[:, 1:] += transfer[count - 1 :, count - 2 :: -1]
    mu = np.linalg.svd(4 * folded - np.eye(count))[2][-1]
    mu *= -2 / (2 * (np.arange(count) ** 2 @ mu))
    nu = -mu  # Eq. 3.14: ν_l = 8 μ_{2l} − μ_l
    coarse_mu = mu[::2]
    nu[: len(coarse_mu)] += 8 * coarse_mu
    for table in (alpha, mu, nu):
        table.setflags(write=False)
    return ConnectionCoefficients(alpha, mu, nu)


def _refinement_matrix(alpha: Floats, size: int) -> Floats:
    """Return the matrix α_{2l − k} / 2, |l|, |k| < size: how refinement maps inner products.

    alpha (P + 1,): autocorrelation of the low filter, which is 0 beyond P.
    """
    index = np.arange(1 - size, size)
    lag = np.abs(2 * index[:, None] - index)
    return np.where(lag < len(alpha), alpha[np.minimum(lag, len(alpha) - 1)], 0) / 2


def _sobolev_smoothness(alpha: Floats) -> float:
    """Return the Sobolev exponent s, at most 2, of a wavelet's scaling function φ.

    φ lies in H^r for every r < s. alpha (P + 1,): autocorrelation of the low filter at lags 0 … P.
    The method is Villemoes's (1992). If every straight line is a sum of shifted φ, the transfer
    operator keeps the moments 0 … 3 of a sequence at 0, and shrinks such a sequence by 4^−s a step,
    in the end. Otherwise φ has a jump or worse, and the result is 0.5.
    """
    size = len(alpha) + 1  # even the shortest filter needs room for four moments
    index = np.arange(1 - size, size) / size
    # An orthonormal basis of sequences: four that span index^0 … index^3; the rest have none of
    # the moments 0 … 3.
    basis = np.linalg.qr(np.stack([index**p for p in range(4)], axis=1), "complete")[0]
    moments, vanishing = basis[:, :4], basis[:, 4:]
    image = _refinement_matrix(alpha, size) @ vanishing
    if np.abs(moments.T @ image).max() > _ALMOST:  # the operator brings moments in
        return 0.5
    shrinkage = float(np.abs(np.linalg.eigvals(vanishing.T @ image)).max())  # 4^−s, a step
    exponent = min(-np.log2(shrinkage) / 2, 2.0)
    # Rounding must not decide whether s > 1, on which the stiffness is finite.
    return exponent if abs(exponent - 1) > _ALMOST else 1.0


def first_stiffness_row(wavelet: str, n: int, elastic: float = 1.0) -> Floats:
    """Return the first row (n,) of the stiffness matrix K of n scaling functions φ (Eq. 3.8).

    K is a symmetric circulant. elastic: the constant e₀. n may be shorter than the wavelet, as for
    the control points of Fig. 7: φ is folded round. FinloopError if n is no power of two, or the
    wavelet has no finite coefficients (`connection_coefficients`).
    """
    count_halvings(n)
    mu = connection_coefficients(wavelet).mu
    offset = np.arange(1 - len(mu), len(mu))
    row = np.zeros(n)
    np.add.at(row, offset % n, mu[np.abs(offset)])
    return elastic * n**2 * row


def stiffness_eigenvalues(wavelet: str, n: int, elastic: float = 1.0) -> Floats:
    """Return the eigenvalues (n // 2 + 1,) of the stiffness matrix K of a curve of n points.

    Their order is that of `numpy.fft.rfft`. elastic: the constant e₀. FinloopError if n is no power
    of two, or the wavelet's stiffness is not finite.
    """
    values = np.fft.rfft(first_stiffness_row(wavelet, n, elastic)).real.copy()
    values[0] = 0  # exactly: a shift strains nothing
    return np.maximum(values, 0)


def stiffness_matrix(wavelet: str, n: int, levels: int, elastic: float = 1.0) -> csr_array:
    """Return the stiffness matrix K (n, n) in the wavelet basis, ordered as by `wavelet_transform`.

    n: points of the curve; elastic: the constant e₀; levels: 0 gives K in the basis of scaling
    functions φ. FinloopError if n cannot be halved `levels` times, the wavelet is longer than the
    curve, or its stiffness is not finite.
    """
    wavelet_for_transform(wavelet, n, levels)  # only to check the arguments
    slices = scale_slices(n, levels)
    first_rows = _first_rows_of_scales(wavelet, n, levels, elastic)
    rows, columns, values = [], [], []
    for number, scale in enumerate(slices):
        for finer in slices[number:]:
            first_row = first_rows[number, finer]
            if finer is scale:
                # A circulant; the mean with its transpose is symmetric to the last digit.
                first_row = (first_row + np.roll(first_row[::-1], 1)) / 2
            row, column, value = _block_entries(first_row, scale, finer)
            rows.append(row)
            columns.append(column)
            values.append(value)
            if finer is not scale:  # the block below the diagonal is the transpose
                rows.append(column)
                columns.append(row)
                values.append(value)
    entries = np.concatenate(rows), np.concatenate(columns)
    return csr_array((np.concatenate(values), entries), shape=(n, n))


def _first_rows_of_scales(wavelet: str, n: int, levels: int, elastic: float) -> Floats:
    """Return the rows (scales, n) of the stiffness matrix for the first function of each scale.

    K is the stiffness matrix in the wavelet basis. Its rows are found without it: the circulant K
    in the basis of φ is applied to these functions. n: points of the curve; levels: halvings;
    elastic: the constant e₀.
    """
    slices = scale_slices(n, levels)
    units = np.zeros((n, len(slices)))
    units[[scale.start for scale in slices], range(len(slices))] = 1
    functions = inverse_transform(units, wavelet, levels)
    stiffness_row = first_stiffness_row(wavelet, n, elastic)
    image = np.zeros_like(functions)
    for offset in np.flatnonzero(stiffness_row):  # zeros stay exactly 0, unlike by FFT
        image += stiffness_row[offset] * np.roll(functions, offset, axis=0)
    return wavelet_transform(image, wavelet, levels).T


def _block_entries(first_row: Floats, scale: slice, finer: slice) -> tuple[Ints, Ints, Floats]:
    """Return rows, columns and values (k,) of the nonzero entries in a stiffness block.

    scale: rows of the block; finer: its columns, of the same scale or a finer one; first_row: its
    first row. Each other row is the row before, moved on round the curve by as many columns as
    there are for a row.
    """
    row_count, column_count = scale.stop - scale.start, finer.stop - finer.start
    steps = np.arange(row_count, dtype=np.int32)
    nonzero = np.flatnonzero(first_row).astype(np.int32)
    row = np.repeat(steps + scale.start, len(nonzero))
    shift = (column_count // row_count) * steps[:, None]
    column = ((nonzero + shift) % column_count + finer.start).ravel()
    return row, column, np.tile(first_row[nonzero], row_count)


def off_diagonal_share(matrix: csr_array) -> float:
    """Return the share (0-1) of a matrix's sum of squares that lies off its diagonal."""
    total = float((matrix.data**2).sum())
    return 1 - float((matrix.diagonal() ** 2).sum()) / total
