"""The periodized transform: round trip, Eq. 2.8 as ground truth, truncation."""

import re

import numpy as np
import pytest
import pywt
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from finloop.base.errors import FinloopError
from finloop.curve.contour import orient_clockwise, resample_curve
from finloop.curve.glyph import glyph_outlines
from finloop.curve.wavelet import (
    CUBIC,
    close_by_mirroring,
    control_points,
    curves_from_control,
    drop_details,
    find_wavelet,
    inverse_transform,
    scale_slices,
    wavelet_transform,
)
from finloop.plots.curve import figure2

ALL = [w for w in pywt.wavelist(kind="discrete") if w != "dmey"] + [CUBIC]
SOME = ["db1", "db4", "coif2", "sym8", "bior3.3", "bior4.4", "rbio2.6", CUBIC]


def curves(n, count=3, seed=0):
    return np.random.default_rng(seed).normal(size=(count, n, 2))


@pytest.mark.parametrize("wavelet", ALL)
def test_there_and_back(wavelet):
    points = curves(128)
    for levels in (1, 7):
        found = inverse_transform(wavelet_transform(points, wavelet, levels), wavelet, levels)
        assert np.abs(found - points).max() <= 1e-9  # tables of sym20 lose most, 3e-11


@pytest.mark.parametrize("wavelet", ["db3", "db4", "coif2"])
@pytest.mark.parametrize("n", [64, 16])
def test_equation_2_8_as_the_paper_writes_it(wavelet, n):
    """c' = Σ h_{l − 2n} c_l, h folded round (2.7); l counts from where PyWavelets starts."""
    h = np.array(pywt.Wavelet(wavelet).rec_lo)
    taps = len(h)
    g = (-1.0) ** np.arange(taps) * h[::-1]  # (2.2), moved by an even number of places
    x = curves(n, 1)[0]
    ours = wavelet_transform(x, wavelet, 1).reshape(2, n // 2, 2)
    for which, taken in enumerate((h, g)):
        folded = np.zeros(n)
        np.add.at(folded, np.arange(taps) % n, taken)
        for k in range(n // 2):
            wanted = np.roll(folded, 2 * k - (taps // 2 - 1)) @ x
            assert np.allclose(ours[which, k], wanted, rtol=0, atol=1e-10)


@given(
    arrays(np.float64, (32, 2), elements=st.floats(-1e3, 1e3)),
    st.sampled_from(SOME),
    st.integers(0, 5),
    st.floats(-3, 3),
)
@settings(max_examples=80)
def test_laws(points, wavelet, levels, factor):
    coefficients = wavelet_transform(points, wavelet, levels)
    larger = wavelet_transform(factor * points, wavelet, levels)
    assert np.allclose(larger, factor * coefficients, atol=1e-9)
    if wavelet in ("db1", "db4", "coif2", "sym8"):  # orthogonal: lengths stay
        assert np.allclose((coefficients**2).sum(), (points**2).sum())
    turned = wavelet_transform(np.roll(points, 1 << levels, axis=0), wavelet, levels)
    for place in scale_slices(32, levels):  # a step at a scale is 2^m steps of the points
        size = place.stop - place.start
        step = (1 << levels) * size // 32
        assert np.allclose(turned[place], np.roll(coefficients[place], step, axis=0), atol=1e-8)
    alone = [wavelet_transform(points[:, [i]], wavelet, levels) for i in (0, 1)]
    assert np.array_equal(coefficients, np.concatenate(alone, axis=1))


def test_a_batch_is_its_curves_and_inputs_stay():
    points = curves(64, 6).reshape(2, 3, 64, 2)
    kept = points.copy()
    found = wavelet_transform(points, "coif2", 3)
    assert np.array_equal(found[1, 2], wavelet_transform(points[1, 2], "coif2", 3))
    assert np.array_equal(points, kept)
    single = points.astype(np.float32)
    assert np.array_equal(wavelet_transform(single, "db4", 0), single)
    assert np.allclose(
        wavelet_transform(points[..., ::2, :], "db4", 2),
        wavelet_transform(points[..., ::2, :].copy(), "db4", 2),
    )


def test_the_cubic_spline_is_fig_2s():
    """Synthesis by 1 4 6 4 1, and cubics reproduced: four moments of either ψ vanish."""
    bank = np.array(find_wavelet(CUBIC).filter_bank)
    low = bank[2][bank[2] != 0]
    assert np.allclose(low / low[0], [1, 4, 6, 4, 1])
    at = np.arange(bank.shape[1])
    for high in (bank[1], bank[3]):
        for power in range(4):
            assert abs(high @ (at - 5.0) ** power) < 1e-11


def test_truncation():
    t = 2 * np.pi * np.arange(256) / 256
    smooth = np.stack([np.cos(t), np.sin(2 * t)], axis=1)
    for wavelet in SOME:
        assert np.allclose(drop_details(smooth, wavelet, 0), smooth)
        rough = drop_details(curves(256), wavelet, 3)
        assert np.allclose(drop_details(rough, wavelet, 3), rough)  # a projection
        kept = control_points(smooth + 5, wavelet, 3)
        assert kept.shape == (32, 2)
        assert np.allclose(kept.mean(axis=0), 5, atol=1e-3)  # in the unit of the points
        plain = drop_details(smooth + 5, wavelet, 3)
        assert np.allclose(curves_from_control(kept, wavelet, 3), plain)
        assert np.allclose(drop_details(np.ones((64, 2)), wavelet, 6), 1)
    errors = [np.abs(drop_details(smooth, "db4", k) - smooth).max() for k in (1, 2, 3, 4, 5)]
    assert errors == sorted(errors)
    assert errors[1] < 1e-3


def test_an_open_curve_keeps_its_ends_apart():
    line = np.stack([np.linspace(0, 1, 64), np.linspace(0, 3, 64)], axis=1)
    there = close_by_mirroring(line)
    assert np.array_equal(there[:64], line)
    assert np.array_equal(there[64:], line[::-1])
    off = np.abs(drop_details(line, "db4", 3, closed=False) - line).max()
    joined = np.abs(drop_details(line, "db4", 3) - line).max()
    assert off < 0.15
    assert joined > 5 * off


@pytest.mark.parametrize(
    ("n", "wavelet", "levels", "word"),
    [
        (100, "db4", 1, "100 points"),
        (1, "db4", 0, "1 points"),
        (64, "db4", 7, "7 levels"),
        (64, "db4", -1, "-1 levels"),
        (8, "coif2", 1, "12 taps"),
        (64, "dmey", 1, "dmey lose"),
        (64, "db99", 1, "db99"),
        (64, "mexh", 1, "mexh"),
    ],
)
def test_what_cannot_be_transformed_is_refused(n, wavelet, levels, word):
    for way in (wavelet_transform, inverse_transform):
        with pytest.raises(FinloopError, match=re.escape(word)):
            way(np.zeros((n, 2)), wavelet, levels)


def test_figure_2_has_both_families_and_five_scales():
    (three,) = glyph_outlines("3")
    curve = resample_curve(orient_clockwise(three), 1024)
    figure = figure2(curve, [(CUBIC, "spline"), ("db4", "D8")])
    assert len(figure.axes) == 10
    x, y = figure.axes[0].lines[0].get_data()
    assert np.array_equal(np.stack([x, y], axis=1)[:-1], curve.points)
    drawn = np.stack(figure.axes[9].lines[0].get_data(), axis=1)[:-1]
    assert np.allclose(drawn, drop_details(curve.points, "db4", 6))
    drawn = [np.stack(axes.lines[0].get_data(), axis=1)[:-1] for axes in figure.axes[:5]]
    off = [np.abs(points - curve.points).max() for points in drawn]
    assert off == sorted(off)
