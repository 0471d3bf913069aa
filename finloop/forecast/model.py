"""The network in use: the mean of the next state, by numpy or, tick by tick, by a kernel.

With x the past (l, d) and u the control, both in units of their scales, and M the mirror:

    mean(x, u) = x₀ + ½ (g(x, u) + g(x M, u M) M),   g: two hidden layers of SiLU units

so the mirrored past and control give the mirrored mean for any weights. M is folded into the
weights of a second, mirrored network g M.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Reals
from finloop.base.kernel import finite_leaf

Weights = NDArray[np.float32]
_LAYERS = ("first", "second", "third")
_UNITS = ("lags", "scale", "control_scale", "mirror", "side")
_FORMAT = "finloop forecast 1"


class KernelWeights(NamedTuple):
    """The weights (2, in, out) and biases (2, out) of the network [0] and of its mirror image [1].

    Kernels use them; the scales of states and controls are folded in.
    """

    first: Weights
    second: Weights
    third: Weights
    first_bias: Weights
    second_bias: Weights
    third_bias: Weights


@dataclass(frozen=True)
class Forecast:
    """The network that predicts the next state: its trained weights, and the units of its numbers.

    With l lags, d state numbers and h hidden units: layers: (l d + 2, h), (h, h), (h, d); biases:
    (h,), (h,), (d,); lags (l,): frames; scale (d,), control_scale (2,): units of states and
    controls; mirror (d, d), side (2,): mirror states and controls (see `FilmStates`).
    """

    layers: tuple[Reals, Reals, Reals]
    biases: tuple[Reals, Reals, Reals]
    lags: Ints
    scale: Floats
    control_scale: Floats
    mirror: Floats
    side: Floats

    def kernel_weights(self) -> KernelWeights:
        """Return the weights of the network and of its mirror image, with the scales folded in.

        So they take and give states in the units of `FilmStates`. The network and its mirror image
        give half of the change each.
        """
        (first, second, third), (first_bias, second_bias, third_bias) = self.layers, self.biases
        size, lags = len(self.scale), len(self.lags)
        unit = np.concatenate([np.tile(self.scale, lags), self.control_scale])
        mirror = np.zeros((len(unit), len(unit)))
        for lag in range(lags):
            mirror[lag * size : (lag + 1) * size, lag * size : (lag + 1) * size] = self.mirror
        mirror[-2, -2], mirror[-1, -1] = self.side
        first = first / unit[:, None]
        third, third_bias = 0.5 * third * self.scale, 0.5 * third_bias * self.scale
        pairs = {  # of the network, of its mirror image
            "first": (first, mirror @ first), "first_bias": (first_bias, first_bias),
            "second": (second, second), "second_bias": (second_bias, second_bias),
            "third": (third, third @ self.mirror),
            "third_bias": (third_bias, third_bias @ self.mirror),
        }  # fmt: skip
        return KernelWeights(**{
            name: np.ascontiguousarray(np.stack(pair), np.float32) for name, pair in pairs.items()
        })  # fmt: skip

    def predict_means(self, past: Reals, control: Reals) -> Floats:
        """Return the means (k, d) of the next states, in the units of `FilmStates`.

        past (k, l, d): the present state first; control (k, 2): displacement and included angle
        over the next Δ.
        """
        net = self.kernel_weights()
        x = np.concatenate([past.reshape(len(past), -1), control], 1)
        mean = past[:, 0].astype(float)
        for side in range(2):
            first = _silu(x @ net.first[side] + net.first_bias[side])
            second = _silu(first @ net.second[side] + net.second_bias[side])
            mean = mean + second @ net.third[side] + net.third_bias[side]
        return mean

    def to_values(self) -> dict[str, Any]:
        """Return the network as plain values for JSON; `restore_forecast` restores it."""
        arrays = dict(zip(_LAYERS, self.layers, strict=True))
        arrays |= {f"{name}_bias": bias for name, bias in zip(_LAYERS, self.biases, strict=True)}
        arrays |= {name: getattr(self, name) for name in _UNITS}
        return {"format": _FORMAT} | {name: array.tolist() for name, array in arrays.items()}


def restore_forecast(**content: Any) -> Forecast:
    """Return the network that the values of `Forecast.to_values` describe.

    KeyError, TypeError or ValueError if a field is missing or has another size, or if weights,
    biases or `mirror` are not finite.
    """
    if content["format"] != _FORMAT:
        raise ValueError(f"no forecast: {_FORMAT!r} is wanted, got {content['format']!r}")
    lags = np.array(content["lags"], np.int64)
    scale, control_scale, mirror, side = (
        np.array(content[name], float) for name in ("scale", "control_scale", "mirror", "side")
    )
    layers = [np.array(content[name], np.float32) for name in _LAYERS]
    biases = [np.array(content[f"{name}_bias"], np.float32) for name in _LAYERS]
    size, hidden = len(scale), len(biases[0])
    sizes = [len(lags) * size + 2, hidden, hidden, size]
    fits = [layer.shape == (sizes[i], sizes[i + 1]) for i, layer in enumerate(layers)]
    fits += [bias.shape == (sizes[i + 1],) for i, bias in enumerate(biases)]
    fits += [mirror.shape == (size, size), control_scale.shape == side.shape == (2,)]
    is_finite = [np.isfinite(array).all() for array in (*layers, *biases, mirror)]
    if not (all(fits) and lags.ndim == 1 and all(is_finite)):
        raise ValueError("weights of other sizes, or not finite")
    return Forecast(
        tuple(layers), tuple(biases), lags=lags, scale=scale,  # type: ignore[arg-type]
        control_scale=control_scale, mirror=mirror, side=side,
    )  # fmt: skip


def _silu(x: Reals) -> Reals:
    """Return x · sigmoid(x), the SiLU of numbers of any shape (Elfwing 2018)."""
    return x / (1 + np.exp(-x))


@finite_leaf
def predict_next_mean(net: KernelWeights, past: Weights, out: Floats, hidden: Weights) -> None:
    """Write the predicted next state of a fish into `out` (d,).

    past (l d + 2,): the states at all lags, the present first, then the control, in the units of
    `FilmStates`; hidden (2, h): memory for the two hidden layers, overwritten.
    """
    size, hidden_units, first, second = out.size, hidden.shape[1], hidden[0], hidden[1]
    # To the present state the change is added, half of it by the network, half by its mirror image.
    for j in range(size):
        out[j] = past[j]
    for side in range(2):
        _compute_layer(past, net.first[side], net.first_bias[side], first)
        _compute_layer(first, net.second[side], net.second_bias[side], second)
        for j in range(size):
            out[j] += net.third_bias[side, j]
        for i in range(hidden_units):
            for j in range(size):
                out[j] += second[i] * net.third[side, i, j]


@finite_leaf
def _compute_layer(x: Weights, weights: Weights, bias: Weights, out: Weights) -> None:
    """Write the output of one layer, SiLU(x · weights + bias), into `out` (units,)."""
    for j in range(out.size):
        out[j] = bias[j]
    for i in range(x.size):
        for j in range(out.size):
            out[j] += x[i] * weights[i, j]
    for j in range(out.size):
        out[j] = out[j] / (1 + np.exp(-out[j]))
