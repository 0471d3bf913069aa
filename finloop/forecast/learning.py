"""How the network learns the mean of the next state (mean squares, AdamW), with early stopping.

The error of each number of the state counts in units of the error of persistence, which predicts no
change. During training the past is disturbed and the next state is not, so the network leads back
to the film's states from nearby (as a denoising autoencoder; Vincent 2008).
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
import torch
from torch import Tensor, nn

from finloop.base.arrays import Ints
from finloop.forecast.film import CONTROL, FilmStates, Partition
from finloop.forecast.model import Forecast
from finloop.forecast.settings import ForecastSettings

_FLOOR = 0.02  # added to the mean squares of changes: nearly constant numbers must not dominate
_LAG_NOISE = 0.3  # share of the noise that differs between lags; the rest shifts the whole past


class _Network(nn.Module):
    """The network while it learns; its output is averaged with that for the mirror image."""

    def __init__(self, film: FilmStates, hidden_units: int) -> None:
        """Build layers for a film's states and controls, which at first predict little change."""
        super().__init__()
        state_size = len(film.scale)
        sizes = (len(film.lags) * state_size + CONTROL, hidden_units, hidden_units, state_size)
        first, second, third = (nn.Linear(before, after) for before, after in pairwise(sizes))
        nn.init.zeros_(third.bias)
        third.weight.data *= 0.1  # at first hardly anything changes
        self.layers = nn.ModuleList([first, second, third])
        mirror = film.mirror * film.scale[:, None] / film.scale
        self.mirror = torch.tensor(mirror, dtype=torch.float64)
        self.side = torch.tensor(film.side, dtype=torch.float64)
        self.double()

    def forward(self, past: Tensor, control: Tensor) -> Tensor:
        """Return the next states (m, d) predicted from pasts (m, l, d) and controls (m, 2).

        All are in units of their scales. The prediction is averaged with the one for the mirror
        image, mirrored back; `mirror` mirrors states, `side` controls.
        """
        mirrored = self.change(past @ self.mirror, control * self.side) @ self.mirror
        return past[:, 0] + 0.5 * (self.change(past, control) + mirrored)

    def change(self, past: Tensor, control: Tensor) -> Tensor:
        """Return the change of state (m, d) predicted from these inputs, without averaging."""
        x = torch.cat([past.flatten(1), control], 1)
        for layer in self.layers[:2]:
            x = nn.functional.silu(layer(x))
        return self.layers[2](x)


def train_predictor(
    film: FilmStates, parts: Partition, p: ForecastSettings,
    advance: Callable[[], object] = lambda: None,
) -> tuple[Forecast, pd.DataFrame]:  # fmt: skip
    """Train the network that predicts the next state; return it with its learning curve.

    The weights are those of the epoch with the least held-out error; `p.patience` epochs without a
    smaller one end the learning. The curve: columns epoch, train_error, held_out_error, mean
    squares, such that predicting no change has the error 1. advance(): called after each epoch.
    """
    with _torch_on_one_thread(p.seed) as generator:
        network = _Network(film, p.hidden_units)
        train, held_out = (_make_sample(film, rows) for rows in (parts.train, parts.held_out))
        best_weights = deepcopy(network.state_dict())
        # Predicting no change has the error 1.
        number_weights = 1 / ((train.past[:, 0] - train.next_states).square().mean(0) + _FLOOR)
        adam = torch.optim.AdamW(
            network.parameters(), lr=p.learning_rate, weight_decay=p.weight_decay
        )
        curve = [_mean_square_errors(network, number_weights, train, held_out)]
        epochs_since_best = 0
        for _ in range(p.epochs):
            _learn_epoch(network, adam, train, number_weights, p, generator)
            curve.append(_mean_square_errors(network, number_weights, train, held_out))
            advance()
            epochs_since_best += 1
            if curve[-1]["held_out_error"] < min(row["held_out_error"] for row in curve[:-1]):
                best_weights, epochs_since_best = deepcopy(network.state_dict()), 0
            if epochs_since_best >= p.patience:
                break
    weights = {name: value.numpy().astype(np.float32) for name, value in best_weights.items()}
    layers = tuple(np.ascontiguousarray(weights[f"layers.{i}.weight"].T) for i in range(3))
    biases = tuple(weights[f"layers.{i}.bias"] for i in range(3))
    model = Forecast(
        layers,  # type: ignore[arg-type]
        biases,
        lags=film.lags, scale=film.scale, control_scale=film.control_scale, mirror=film.mirror,
        side=film.side,
    )  # fmt: skip
    return model, pd.DataFrame(curve).rename_axis("epoch").reset_index()


class _Sample(NamedTuple):
    """Pasts (m, l, d), controls (m, 2) and next states (m, d), in units of their scales."""

    past: Tensor
    control: Tensor
    next_states: Tensor


def _make_sample(film: FilmStates, rows: Ints) -> _Sample:
    """Return the network's learning material from rows (m,): pasts, controls and next states."""
    arrays = (
        film.past(rows) / film.scale, film.control[rows] / film.control_scale,
        film.states[rows + 1] / film.scale,
    )  # fmt: skip
    return _Sample(*(torch.tensor(array, dtype=torch.float64) for array in arrays))


def _learn_epoch(
    network: _Network, adam: torch.optim.Optimizer, sample: _Sample, number_weights: Tensor,
    p: ForecastSettings, generator: torch.Generator,
) -> None:  # fmt: skip
    """Train the network once on the whole sample, in random batches, with noise on the past.

    Batches have equal sizes. What does not fill a last batch is left out. number_weights (d,): of
    each state number's error.
    """
    count = len(sample.past)
    batch_size = min(p.batch_size, count)
    shuffled = torch.randperm(count, generator=generator)
    for first in range(0, count - batch_size + 1, batch_size):
        batch = shuffled[first : first + batch_size]
        past, control, next_states = (tensor[batch] for tensor in sample)
        noise = p.input_noise_sd * _draw_disturbances(past.shape, generator)
        error = network(past + noise, control) - next_states
        loss = (error.square() * number_weights).mean()
        adam.zero_grad()
        loss.backward()
        adam.step()


def _draw_disturbances(shape: torch.Size, generator: torch.Generator) -> Tensor:
    """Return noise (m, l, d) for m pasts of l lags: one shift for all lags, and one for each lag.

    The sizes of both, standard deviations, are drawn anew for each of the m rows, up to 1 and up to
    `_LAG_NOISE`.
    """
    rows, lags, state_size = shape
    common, single = (
        torch.randn(rows, count, state_size, generator=generator, dtype=torch.float64)
        for count in (1, lags)
    )
    sizes = torch.rand(2, rows, 1, 1, generator=generator, dtype=torch.float64)
    return sizes[0] * common + sizes[1] * _LAG_NOISE * single


def _mean_square_errors(
    network: _Network, number_weights: Tensor, train: _Sample, held_out: _Sample
) -> dict[str, float]:
    """Return the weighted mean square errors `train_error` and `held_out_error` of the network.

    number_weights (d,): weight of the error of each of the numbers that the network predicts.
    """
    errors = {}
    with torch.inference_mode():
        for name, sample in (("train", train), ("held_out", held_out)):
            squares = (network(sample.past, sample.control) - sample.next_states).square().mean(0)
            errors[f"{name}_error"] = float((squares * number_weights).mean())
    return errors


@contextmanager
def _torch_on_one_thread(seed: int) -> Iterator[torch.Generator]:
    """Run torch on one thread, so that sums are reproducible; yield a seeded generator.

    The seed also draws the first weights. Threads and random state are restored at the end.
    """
    thread_count = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            yield torch.Generator().manual_seed(seed)
    finally:
        torch.set_num_threads(thread_count)
