"""Connection coefficients and K: Tables 1 and 2, an independent quadrature, every block, Fig. 3.

Table 2's corrected entries and the off-diagonal energies are those of
docs/equations/curve-3-2-stiffness.md.
"""

import numpy as np
import pytest
import pywt

from finloop.base.errors import FinloopError
from finloop.curve.stiffness import (
    connection_coefficients,
    first_stiffness_row,
    off_diagonal_share,
    stiffness_eigenvalues,
    stiffness_matrix,
)
from finloop.curve.wavelet import scale_slices, wavelet_transform
from finloop.plots.curve import figure3

# As printed: α, μ, ν.
TABLE_1 = np.array(
    [
        [2.000000000000, 1.000000000000, 1.000000000000],
        [1.196289062500, -0.634202334430, 0.282047701976],
        [0, 0.167516447426, -0.021030490453],
        [-0.239257812500, -0.036239523491, 0.005172706977],
        [0, 0.002537876782, -0.000362553826],
        [0.047851562500, 0.000391355545, -0.000055907935],
        [0, -0.000003821831, 0.000000545976],
        [-0.004882812500, 0, 0],
    ]
)
TABLE_2 = np.array(
    [
        [2.000000000000, 1.000000000000, 1.000000000000],
        [1.200356164723, -0.632970245318, 0.282556453372],
        [0, 0.168115616035, -0.019065712435],
        [-0.247533711568, -0.039535740096, 0.005642288176],
        [0, 0.004331953624, -0.000618851965],
        [0.054015945115, 0.000061489440, -0.000008784206],
        [0, -0.000004965358, 0.000000709337],
        [-0.007246984423, 0.000001893038, -2.70434e-7],  # printed with a zero too few, from here
        [0, -1.267e-9, 1.809e-10],
        [0.000432201936, -8.9e-11, 1.28e-11],
        [0, 0, 0],
        [-0.000023615772, 0, 0],
    ]
)
SMOOTH = ["db3", "db4", "db6", "db10", "db20", "sym4", "sym8", "coif1", "coif2", "coif5"]


def pad_zeros(values, count):
    return np.concatenate([values, np.zeros(count - len(values))])


def test_table_1_to_all_twelve_digits():
    table = connection_coefficients("db4")
    ours_of_table = table.autocorrelation, table.mu / table.mu[0], table.nu / table.nu[0]
    for printed, ours in zip(TABLE_1.T, ours_of_table, strict=True):
        assert np.abs(pad_zeros(ours, 8) - printed).max() < 0.51e-12
    assert table.mu[0] == pytest.approx(4.165973640696, abs=1e-12)


def test_table_2_corrected():
    """The α printed are right to 11 digits, μ and ν to 9; the small ones stand as they should be."""
    table = connection_coefficients("coif2")
    mu, nu = table.mu / table.mu[0], table.nu / table.nu[0]
    assert np.abs(pad_zeros(table.autocorrelation, 12) - TABLE_2[:, 0]).max() < 1e-11
    for column, ours in ((1, mu), (2, nu)):
        assert np.abs(pad_zeros(ours, 12) - TABLE_2[:, column]).max() < 2e-10
    assert nu[7] == pytest.approx(-2.70434e-7, abs=0.51e-12)
    assert mu[8] == pytest.approx(-1.267e-9, abs=0.51e-12)
    assert nu[8] == pytest.approx(1.809e-10, abs=0.51e-13)
    assert mu[9] == pytest.approx(-8.9e-11, abs=0.51e-12)
    assert nu[9] == pytest.approx(1.28e-11, abs=0.51e-13)
    assert table.mu[0] == pytest.approx(4.072207900327, abs=1e-12)


@pytest.mark.parametrize("wavelet", SMOOTH)
def test_laws_of_connection_coefficients(wavelet):
    table = connection_coefficients(wavelet)
    mu, nu = (np.concatenate([half[:0:-1], half]) for half in (table.mu, table.nu))
    at = np.arange(len(mu)) - len(mu) // 2
    assert abs(mu.sum()) < 1e-10  # a constant strains nothing
    assert at**2 @ mu == pytest.approx(-2, abs=1e-10)  # x has slope 1
    assert table.nu[0] == pytest.approx(7 * table.mu[0])
    # (3.12) in full, from the filters: no use is made of (3.13), (3.14).
    low, high = (np.array(f) for f in (pywt.Wavelet(wavelet).rec_lo, pywt.Wavelet(wavelet).rec_hi))
    middle = len(mu) // 2
    for filters, wanted in ((low, mu), (high, nu)):
        auto = np.correlate(filters, filters, "full")  # at difference m − n
        spread = np.arange(len(auto)) - len(auto) // 2
        for l in range(len(low)):  # noqa: E741
            place = 2 * l + spread + middle
            inside = (place >= 0) & (place < len(mu))
            value = 4 * auto[inside] @ mu[place[inside]]
            expected = wanted[l + middle] if l + middle < len(wanted) else 0.0
            assert value == pytest.approx(expected, abs=1e-8)


def test_mu_is_the_integral():
    """∫ φ'(x − l) φ'(x) of a wavelet smooth enough to be drawn and differentiated."""
    phi, _, x = pywt.Wavelet("db10").wavefun(level=12)
    step = x[1] - x[0]
    slope = np.gradient(phi, step)
    one = round(1 / step)
    for l in range(6):  # noqa: E741
        integral = (slope[l * one :] * slope[: len(slope) - l * one]).sum() * step
        assert integral == pytest.approx(connection_coefficients("db10").mu[l], abs=2e-3)


@pytest.mark.parametrize(
    ("wavelet", "word"),
    [("db1", r"H\^s for s < 0.50"), ("haar", "not square integrable"), ("db2", r"H\^s for s < 1.00"),
     ("sym2", "not square integrable"), ("bior3.3", "not orthogonal"), ("cubic", "not orthogonal")],
)  # fmt: skip
def test_wavelets_without_stiffness_are_refused_with_the_reason(wavelet, word):
    with pytest.raises(FinloopError, match=word):
        stiffness_matrix(wavelet, 64, 0)


@pytest.mark.parametrize("wavelet", ["db3", "db4", "coif2", "sym8", "db20"])
def test_low_eigenvalues_are_the_circles(wavelet):
    """e₀ (2πk)², ever closer as n grows, from the FFT as from K itself."""
    wanted = (2 * np.pi * np.arange(4)) ** 2
    errors = [np.abs(stiffness_eigenvalues(wavelet, n)[:4] - wanted).max() for n in (64, 256)]
    assert errors[1] < max(errors[0] / 8, 1e-8)
    assert errors[1] < 1
    dense = np.linalg.eigvalsh(stiffness_matrix(wavelet, 64, 0, 3.0).toarray())
    fast = stiffness_eigenvalues(wavelet, 64, 3.0)
    assert np.allclose(np.sort(np.r_[fast, fast[1:-1]]), dense, atol=1e-8 * dense.max())
    sizes = [2**m for m in range(3, 11)]
    assert all(stiffness_eigenvalues(wavelet, n, e)[0] == 0 for n in sizes for e in (1, 0.3))


@pytest.mark.parametrize(
    ("wavelet", "n", "levels"),
    [("db4", 64, 1), ("coif2", 64, 2), ("coif2", 32, 5), ("sym8", 16, 4)],
)
def test_every_block_is_the_transformed_k(wavelet, n, levels):
    whole = stiffness_matrix(wavelet, n, levels, 2.0).toarray()
    basis = wavelet_transform(np.eye(n), wavelet, levels)
    wanted = 2 * basis @ stiffness_matrix(wavelet, n, 0).toarray() @ basis.T
    assert np.allclose(whole, wanted, atol=1e-9 * n**2)
    assert np.array_equal(whole, whole.T)


def test_diagonal_blocks_are_mu_and_nu():
    """Eqs. 3.8, 3.9: at a scale of m functions, m² μ and m² ν round and round."""
    n, levels = 256, 3
    whole = stiffness_matrix("coif2", n, levels).toarray()
    table = connection_coefficients("coif2")
    for number, place in enumerate(scale_slices(n, levels)):
        block = whole[place, place]
        m = len(block)
        values = table.nu if number else table.mu
        row = np.zeros(m)
        for l in range(1 - len(values), len(values)):  # noqa: E741
            row[l % m] += m**2 * values[abs(l)]
        if number == 0:
            assert np.allclose(row, first_stiffness_row("coif2", m))
        # ψ of scale m hangs on the φ of scale 2m: twice as fine, a quarter as often.
        assert np.allclose(block, [np.roll(row, k) for k in range(m)], atol=1e-9 * n**2)


def test_k_is_sparse_and_fine_control_points_may_be_fewer_than_taps():
    k = stiffness_matrix("coif2", 1024, 3)
    assert k.nnz < 0.09 * 1024**2
    row = first_stiffness_row("coif2", 4)  # Fig. 7: φ folded round
    assert row.sum() == pytest.approx(0, abs=1e-9)
    with pytest.raises(FinloopError, match="12 taps"):
        stiffness_matrix("coif2", 8, 1)
    with pytest.raises(FinloopError, match="100 points"):
        first_stiffness_row("coif2", 100)


@pytest.mark.parametrize(
    ("wavelet", "one", "more"),
    [("db4", 16.1, 15.2), ("coif2", 16.0, 15.1), ("db6", 15.6, 14.7), ("sym8", 15.5, 14.6)],
)
def test_off_diagonal_energy(wavelet, one, more):
    """Not "less than 15 %" for the paper's own wavelets, but near it; the ψ block alone is."""
    whole = [stiffness_matrix(wavelet, 1024, levels) for levels in (1, 2, 5)]
    found = [100 * off_diagonal_share(k) for k in whole]
    assert found[0] == pytest.approx(one, abs=0.051)
    assert found[1] == pytest.approx(more, abs=0.051)
    assert found[2] == pytest.approx(more, abs=0.1)
    details = whole[0][512:, 512:]
    assert 13.7 < 100 * off_diagonal_share(details) < 14.3


def test_figure_3_shows_k():
    k = stiffness_matrix("coif2", 64, 2)
    ax = figure3(k, 2, "K").axes[0]
    shown = ax.images[0].get_array()
    assert shown.shape == (64, 64)
    dense = np.abs(k.toarray())
    assert np.nanargmax(np.ma.filled(shown, np.nan)) == dense.argmax()
    assert sorted({line.get_xdata()[0] for line in ax.lines} - {0}) == [15.5, 31.5]
