"""Plain back-propagation of the network 4-hidden-2 (fish paper §3.1, §5.1.1, Figs. 6, 15).

The gradient is written out with torch's own kernels: at this size the book-keeping of autograd and
of torch.optim costs several times what the arithmetic does. Tests hold it to autograd and to
finite differences.

Glossary: x a batch of scaled inputs and a 1; h the hidden layer; o the outputs; t the targets;
E = ½ Σ (o - t)² over the batch and both outputs. Sums, not means: a batch of one is the paper's
rule, a larger one takes the sum of its steps.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.bpn.model import (
    INPUTS,
    MARGIN,
    OUTPUT_HIGH,
    OUTPUT_LOW,
    OUTPUTS,
    MotionModel,
    Rows,
    input_range,
    to_scale,
)
from finloop.bpn.settings import Settings

# The bias of the outputs is the weight of one more hidden unit, which is always on: sigmoid(40) is
# 1 to the last bit, so its slope h (1 - h) is 0 and its own weights never change.
ALWAYS_ON = 40.0
RUN_AWAY = 1e6  # of a weight: its sigmoid has long been a mere switch
_IN, _OUT = len(INPUTS) + 1, len(OUTPUTS)


def new_weights(hidden: int, rng: np.random.Generator) -> Tensor:
    """Flat random weights, uniform within ±√(6 / (units before + units after)); biases 0."""
    weights = torch.zeros((_IN + _OUT) * (hidden + 1), dtype=torch.float64)
    first, second = layers(weights)
    for layer in (first[:-1, :-1], second[:-1]):
        reach = np.sqrt(6 / sum(layer.shape))
        layer.copy_(torch.from_numpy(rng.uniform(-reach, reach, layer.shape)))
    first[-1, -1] = ALWAYS_ON
    return weights


def layers(weights: Tensor) -> tuple[Tensor, Tensor]:
    """Both layers of flat weights, (5, hidden + 1) and (hidden + 1, 2): views."""
    units = len(weights) // (_IN + _OUT)
    return weights[: _IN * units].view(_IN, units), weights[_IN * units :].view(units, _OUT)


def forward(weights: Tensor, x: Tensor) -> Tensor:
    """Fig. 6: x (n, 5) → o (n, 2)."""
    first, second = layers(weights)
    return torch.sigmoid(torch.sigmoid(x @ first) @ second)


def stepper(
    weights: Tensor, velocity: Tensor, rows: int, learning_rate: float, momentum: float
) -> Callable[[Tensor, Tensor, Tensor], None]:
    """Make `step(x, xᵀ, t)` for batches of that many rows, which changes weights and velocity.

    velocity ← momentum · velocity - learning rate · ∂E/∂weights; weights ← weights + velocity.
    """
    first, second = layers(weights)
    first_velocity, second_velocity = layers(velocity)
    second_t = second.T
    h = weights.new_empty(rows, len(second))
    h_t, dh = h.T, torch.empty_like(h)
    o = weights.new_empty(rows, _OUT)
    do = torch.empty_like(o)
    sigmoid, mm, sub = torch.sigmoid_, torch.mm, torch.sub
    slope = torch.ops.aten.sigmoid_backward.grad_input  # d · y (1 - y) in one pass
    rate = -learning_rate

    def step(x: Tensor, x_t: Tensor, t: Tensor) -> None:
        mm(x, first, out=h)
        sigmoid(h)
        mm(h, second, out=o)
        sigmoid(o)
        sub(o, t, out=do)
        slope(do, o, grad_input=do)
        mm(do, second_t, out=dh)
        slope(dh, h, grad_input=dh)
        second_velocity.addmm_(h_t, do, beta=momentum, alpha=rate)
        first_velocity.addmm_(x_t, dh, beta=momentum, alpha=rate)
        weights.add_(velocity)

    return step


def learn(
    rows: Rows,
    sides: tuple[Mask, Mask],
    p: Settings,
    rate_hz: float,
    advance: Callable[[], object] = lambda: None,
) -> tuple[MotionModel, pd.DataFrame]:
    """`train` on the first of two masks of rows; the second, held out, is for the curve."""
    training, held_out = ((rows.inputs[side], rows.outputs[side]) for side in sides)
    rng = np.random.default_rng((p.seed, 1))
    return train(*training, held_out, p, rows.delta_frames / rate_hz, rng, advance)


def train(
    inputs: Floats,
    outputs: Floats,
    held_out: tuple[Floats, Floats],
    settings: Settings,
    delta_s: float,
    rng: np.random.Generator,
    advance: Callable[[], object] = lambda: None,
) -> tuple[MotionModel, pd.DataFrame]:
    """Learn from inputs (n, 4) and outputs (n, 2), which are `delta_s` later.

    held_out: inputs and outputs for the curve alone; rng: for the first weights
    and the order of rows, the same gives the same bits again; advance: called after each epoch.

    Returns the model, and the errors after each epoch (Fig. 15); epoch 0: the untaught network.
    """
    device = _device(settings.device)
    low, high = input_range(inputs)
    x, t = _tensors(inputs, outputs, low, high, device)
    watched = {"train": (x, t), "held_out": _tensors(*held_out, low, high, device)}
    size = min(settings.batch_size, len(x))
    whole = len(x) // size * size
    with _one_thread(), torch.inference_mode():
        weights = new_weights(settings.hidden, rng).to(device)
        velocity = torch.zeros_like(weights)
        how = settings.learning_rate, settings.momentum
        step = stepper(weights, velocity, size, *how)
        rest = stepper(weights, velocity, max(1, len(x) - whole), *how)
        curve = [_errors(weights, watched)]
        for _ in range(settings.epochs):
            order = torch.from_numpy(rng.permutation(len(x))).to(device)
            shuffled, targets = x[order], t[order]
            batches = shuffled[:whole].view(-1, size, _IN)
            for batch, batch_t, target in zip(
                batches.unbind(),
                batches.transpose(1, 2).unbind(),
                targets[:whole].view(-1, size, _OUT).unbind(),
                strict=True,
            ):
                step(batch, batch_t, target)
            if whole < len(x):
                rest(shuffled[whole:], shuffled[whole:].T, targets[whole:])
            curve.append(_errors(weights, watched))
            advance()
        first, second = (layer.cpu().numpy().copy() for layer in layers(weights))
    _check_growth(first, second, settings)
    model = MotionModel(
        delta_s, low, high, OUTPUT_LOW, OUTPUT_HIGH, MARGIN,
        first[:-1, :-1], first[-1, :-1], second[:-1], second[-1],
    )  # fmt: skip
    return model, pd.DataFrame(curve).rename_axis("epoch").reset_index()


def _tensors(
    inputs: Floats, outputs: Floats, low: Floats, high: Floats, device: torch.device
) -> tuple[Tensor, Tensor]:
    """Inputs (n, 5), scaled and with a last 1, and targets (n, 2), within the margin."""
    x = np.column_stack([to_scale(inputs, low, high), np.ones(len(inputs))])
    share = (outputs - OUTPUT_LOW) / (OUTPUT_HIGH - OUTPUT_LOW)
    t = MARGIN + (1 - 2 * MARGIN) * share
    return torch.from_numpy(x).to(device), torch.from_numpy(t).to(device)


def _check_growth(first: Floats, second: Floats, settings: Settings) -> None:
    """Refuse weights, (inputs, hidden) and (hidden, outputs), that grew without bound."""
    if not max(np.abs(first).max(), np.abs(second).max()) < RUN_AWAY:
        raise FinloopError(
            f"the weights grew without bound (learning rate {settings.learning_rate:g}, momentum "
            f"{settings.momentum:g}, at most {settings.batch_size} rows a batch)",
            "steps so small that they find a way down",
            "a smaller bpn.learning_rate (it counts per row of a batch) or a smaller bpn.momentum",
        )


def _errors(weights: Tensor, watched: dict[str, tuple[Tensor, Tensor]]) -> dict[str, float]:
    """The errors of `finloop.bpn.held_out.errors`, for the curve."""
    result: dict[str, float] = {}
    for side, (x, t) in watched.items():
        share = ((forward(weights, x) - MARGIN) / (1 - 2 * MARGIN)).clamp(0, 1)
        true = (t - MARGIN) / (1 - 2 * MARGIN)
        area, kind = (share - true).square().mean(0).sqrt().tolist()
        wrong = (2 * share[:, 1] - 1).round() != (2 * true[:, 1] - 1).round()
        result |= {
            f"{side}_area_rmse": area,
            f"{side}_type_rmse": 2 * kind,
            f"{side}_type_error_pct": 100 * wrong.double().mean().item(),
        }
    return result


def _device(name: str) -> torch.device:
    if name == "cuda" and not torch.cuda.is_available():
        raise FinloopError(
            "bpn.device=cuda, but torch finds no CUDA device here",
            "a GPU, its driver, and a torch built for CUDA",
            "bpn.device=cpu: a network this small learns faster there anyway",
        )
    return torch.device(name)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Torch on one thread: sums in one order give the same bits, and nothing here is big enough."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
