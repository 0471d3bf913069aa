"""Plain back-propagation of the network 4-hidden-2 (fish paper §3.1, §5.1.1, Figs. 6, 15).

Glossary: x a row of scaled inputs and a 1; h the hidden layer and a 1; o the outputs; t the
targets; E = ½ Σ (o - t)² over both outputs of a row.
"""

import math
from collections.abc import Callable

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.base.kernel import for_kernels, kernel, leaf_kernel
from finloop.bpn.held_out import COMPARED, state_errors
from finloop.bpn.model import (
    INPUTS,
    MARGIN,
    OUTPUT_HIGH,
    OUTPUT_LOW,
    OUTPUTS,
    LearningRows,
    MotionModel,
    find_input_range,
    scale_to_unit,
)
from finloop.bpn.settings import BpnSettings

_PART = 4096  # rows whose hidden layer fits the processor's cache: 200,000 at once take 5 × as long
_RUN_AWAY = 1e6  # size of a weight at which its sigmoid is a mere switch
_IN, _OUT = len(INPUTS) + 1, len(OUTPUTS)


def draw_first_weights(hidden_units: int, rng: np.random.Generator) -> Floats:
    """Return random first weights of the network as one flat vector, (7 hidden_units + 2,).

    `split_layers` splits it. Each layer is uniform within ±√(6 / (units before + units after)), the
    rule of Glorot and Bengio (2010); biases are 0.
    """
    weights = np.zeros((_IN + _OUT) * hidden_units + _OUT)
    for layer in split_layers(weights):
        unit_weights = layer[:, :-1].T  # a view: what is drawn stands in `weights`
        reach = np.sqrt(6 / sum(unit_weights.shape))
        unit_weights[:] = rng.uniform(-reach, reach, unit_weights.shape)
    return weights


@for_kernels
def split_layers(weights: Floats) -> tuple[Floats, Floats]:
    """Return the hidden layer (hidden, 5) and the output layer (2, hidden + 1) of flat weights.

    Both are views; a row has the weights of one unit, its bias last.
    """
    hidden = (len(weights) - _OUT) // (_IN + _OUT)
    first, second = weights[: _IN * hidden], weights[_IN * hidden :]
    return first.reshape(hidden, _IN), second.reshape(_OUT, hidden + 1)


@leaf_kernel
def unit_output(weights: Floats, signals: Floats) -> float:
    """Return the output of one unit, 0 … 1: the sigmoid of its weighted inputs (Fig. 6).

    weights, signals: (k,); the last signal is 1, so the last weight is the bias.
    """
    z = 0.0
    for i in range(len(signals)):
        z += weights[i] * signals[i]
    return 1 / (1 + math.exp(-z))


@kernel
def learn_epoch(
    x: Floats, t: Floats, weights: Floats, velocity: Floats, learning_rate: float, momentum: float
) -> None:
    """Train the network once on every row by back-propagation (§3.1), in place.

    x (n, 5): scaled inputs and a 1; t (n, 2): scaled targets, in 0 … 1; both are used in their
    order. weights, velocity: changed; flat, of the hidden layer and then of the output layer, each
    unit's bias last. After each row velocity ← momentum · velocity - learning rate · ∂E/∂weights,
    and weights ← weights + velocity.
    """
    first, second = split_layers(weights)
    first_velocity, second_velocity = split_layers(velocity)
    hidden = len(first)
    # E = ½ Σ (output − t)². The hidden outputs and a 1; and per output unit k, in `step`, the
    # learning rate times ∂E/∂z, z being its weighted inputs.
    hidden_signals, step = np.ones(hidden + 1), np.empty(_OUT)
    for row in range(len(x)):
        velocity *= momentum
        for j in range(hidden):
            hidden_signals[j] = unit_output(first[j], x[row])
        for k in range(_OUT):
            output = unit_output(second[k], hidden_signals)
            step[k] = learning_rate * (output - t[row, k]) * output * (1 - output)
        for j in range(hidden):
            gradient = 0.0  # the learning rate times ∂E/∂(weighted inputs) of hidden unit j
            for k in range(_OUT):
                gradient += second[k, j] * step[k]
            gradient *= hidden_signals[j] * (1 - hidden_signals[j])  # the sigmoid's derivative
            for i in range(_IN):
                first_velocity[j, i] -= gradient * x[row, i]
        for k in range(_OUT):
            for j in range(hidden + 1):
                second_velocity[k, j] -= step[k] * hidden_signals[j]
        weights += velocity


def train_on_film_rows(
    rows: LearningRows, sides: tuple[Mask, Mask], settings: BpnSettings, rate_hz: float,
    advance: Callable[[], object] = lambda: None,
) -> tuple[MotionModel, pd.DataFrame]:  # fmt: skip
    """Train the network on some of a film's rows; return it and the table of its errors (Fig. 15).

    The table is that of `train_motion_model`. sides: masks (n,) of the rows to learn from, and of
    those held out to measure errors; rate_hz: frames a second of the film; advance: called after
    each epoch.
    """
    training, held_out = ((rows.inputs[side], rows.outputs[side]) for side in sides)
    # 1: other random numbers than those that divide the rows, of (seed, 0).
    rng, delta_s = np.random.default_rng((settings.seed, 1)), rows.delta_frames / rate_hz
    return train_motion_model(*training, held_out, settings, delta_s, rng, advance)


def train_motion_model(
    inputs: Floats, outputs: Floats, held_out: tuple[Floats, Floats], settings: BpnSettings,
    delta_s: float, rng: np.random.Generator, advance: Callable[[], object] = lambda: None,
) -> tuple[MotionModel, pd.DataFrame]:  # fmt: skip
    """Train the network; return it and the table of its errors after each epoch (Fig. 15).

    inputs (n, 4), outputs (n, 2): in the units of INPUTS, OUTPUTS; outputs are `delta_s` seconds
    later. held_out: inputs and outputs of other rows, only to measure errors. rng: draws the first
    weights and the order of rows. advance: called after each epoch. The table has the errors
    COMPARED of both sets, as train_… and held_out_…; in epoch 0 the network is untrained.
    """
    # Scaled inputs x and targets t; these keep a margin from 0 and 1, which no sigmoid reaches.
    low, high = find_input_range(inputs)
    x = np.column_stack([scale_to_unit(inputs, low, high), np.ones(len(inputs))])
    t = MARGIN + (1 - 2 * MARGIN) * (outputs - OUTPUT_LOW) / (OUTPUT_HIGH - OUTPUT_LOW)
    watched = {"train": (inputs, outputs), "held_out": held_out}
    weights = draw_first_weights(settings.hidden_units, rng)
    velocity = np.zeros_like(weights)
    model = model_from_weights(weights, low, high, delta_s)
    curve = [_learning_curve_row(model, watched)]
    for _ in range(settings.epochs):
        order = rng.permutation(len(x))
        learn_epoch(
            x[order], t[order], weights, velocity, settings.learning_rate, settings.momentum
        )
        if not np.abs(weights).max() < _RUN_AWAY:  # NaN, too
            raise FinloopError(
                f"the weights grew without bound (learning rate {settings.learning_rate:g}, "
                f"momentum {settings.momentum:g})",
                "steps that are small enough to lower the error",
                "a smaller bpn.learning_rate or bpn.momentum",
            )
        model = model_from_weights(weights, low, high, delta_s)
        curve.append(_learning_curve_row(model, watched))
        advance()
    return model, pd.DataFrame(curve).rename_axis("epoch").reset_index()


def model_from_weights(weights: Floats, low: Floats, high: Floats, delta_s: float) -> MotionModel:
    """Return a motion model built from flat weights, which are copied.

    weights: of the hidden layer, then of the output layer, unit by unit, each unit's bias last.
    low, high (4,): the inputs that are scaled to -1 and 1, in the units of INPUTS; delta_s: Δ [s].
    """
    hidden, output = (layer.T.copy() for layer in split_layers(weights))
    return MotionModel(
        delta_s, MARGIN, input_low=low, input_high=high,
        output_low=OUTPUT_LOW, output_high=OUTPUT_HIGH,
        hidden_weights=hidden[:-1], hidden_bias=hidden[-1],
        output_weights=output[:-1], output_bias=output[-1],
    )  # fmt: skip


def _learning_curve_row(
    model: MotionModel, sides: dict[str, tuple[Floats, Floats]]
) -> dict[str, float]:
    """Return a row of the learning curve: the model's errors on training and on held-out rows.

    sides: inputs and outputs by name, "train" and "held_out"; the errors of a side without rows are
    NaN.
    """
    result: dict[str, float] = {}
    for side, (inputs, outputs) in sides.items():
        parts = [
            model.predict(inputs[start : start + _PART]) for start in range(0, len(inputs), _PART)
        ]
        errors = state_errors(np.concatenate(parts), outputs) if parts else {}
        result |= {f"{side}_{name}": errors.get(name, math.nan) for name in COMPARED}
    return result
