"""How the network learns the mean of the next state (mean squares, AdamW), with early stopping.

The error of each number of the state counts in units of the error of persistence, which predicts no
change. During training the past is disturbed and the next state is not, so the network leads back
to the film's states from nearby (as a denoising autoencoder; Vincent 2008).
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pandas as pd
import torch
from torch import Tensor, nn

from finloop.base.arrays import Ints
from finloop.forecast.film import CONTROL, FilmStates, Partition
from finloop.forecast.model import Forecast
from finloop.forecast.settings import ForecastSettings

_FLOOR = 0.02  # least share of a variance: nearly constant numbers must not dominate
_STEADY = 0.3  # share of the noise that differs between lags; the rest shifts the whole past


class _Network(nn.Module):
    """The network while it learns; its output is averaged with that for the mirror image."""

    def __init__(self, film: FilmStates, hidden_units: int) -> None:
        """Build layers for a film's states and controls, which at first predict no change."""
        super().__init__()
        d = len(film.scale)
        sizes = (len(film.lags) * d + CONTROL, hidden_units, hidden_units, d)
        first, second, third = (nn.Linear(before, after) for before, after in pairwise(sizes))
        nn.init.zeros_(third.bias)
        third.weight.data *= 0.1  # at first nothing changes
        self.layers = nn.ModuleList([first, second, third])
        mirror = film.mirror * film.scale[:, None] / film.scale
        self.mirror = torch.tensor(mirror, dtype=torch.float64)
        self.side = torch.tensor(film.side, dtype=torch.float64)
        self.double()

    def forward(self, past: Tensor, control: Tensor) -> Tensor:
        """Predict the next states (m, d) from pasts (m, l, d) and controls (m, 2)."""
        mirrored = self.change(past @ self.mirror, control * self.side) @ self.mirror
        return past[:, 0] + 0.5 * (self.change(past, control) + mirrored)

    def change(self, past: Tensor, control: Tensor) -> Tensor:
        """Return the change of state (m, d) that the network predicts without its mirror image."""
        x = torch.cat([past.flatten(1), control], 1)
        for layer in self.layers[:2]:
            x = nn.functional.silu(layer(x))
        return self.layers[2](x)


def train_predictor(
    film: FilmStates,
    parts: Partition,
    p: ForecastSettings,
    advance: Callable[[], object] = lambda: None,
) -> tuple[Forecast, pd.DataFrame]:
    """Train the network that predicts the next state; return it with its learning curve.

    The weights are those of the epoch with the least held-out error. The curve: columns epoch,
    train_error, held_out_error, mean squares; 1 is the error of predicting no change. advance():
    called after each epoch.
    """
    with _torch_on_one_thread(p.seed) as chance:
        network = _Network(film, p.hidden_units)
        train, held_out = (_make_sample(film, rows) for rows in (parts.train, parts.held_out))
        weight = 1 / ((train[0][:, 0] - train[2]).square().mean(0) + _FLOOR)
        adam = torch.optim.AdamW(
            network.parameters(), lr=p.learning_rate, weight_decay=p.weight_decay
        )
        curve = [_mean_square_errors(network, weight, train, held_out)]
        best, wait = _copy_weights(network), 0
        for _ in range(p.epochs):
            _learn_epoch(network, adam, (train, weight), p, chance)
            curve.append(_mean_square_errors(network, weight, train, held_out))
            advance()
            wait += 1
            if curve[-1]["held_out_error"] < min(row["held_out_error"] for row in curve[:-1]):
                best, wait = _copy_weights(network), 0
            if wait >= p.patience:
                break
    weights = {name: value.numpy().astype(np.float32) for name, value in best.items()}
    layers = tuple(np.ascontiguousarray(weights[f"layers.{i}.weight"].T) for i in range(3))
    biases = tuple(weights[f"layers.{i}.bias"] for i in range(3))
    model = Forecast(
        layers, biases, film.lags, film.scale, film.control_scale, film.mirror, film.side  # type: ignore[arg-type]
    )  # fmt: skip
    return model, pd.DataFrame(curve).rename_axis("epoch").reset_index()


Sample = tuple[Tensor, Tensor, Tensor]
"""Pasts (m, l, d), controls (m, 2) and next states (m, d), in units of their scales."""


def _make_sample(film: FilmStates, rows: Ints) -> Sample:
    """Return what the network learns from rows (m,) of a film: pasts, controls and next states."""
    parts = (
        film.past(rows) / film.scale, film.control[rows] / film.control_scale,
        film.states[rows + 1] / film.scale,
    )  # fmt: skip
    past, control, later = (torch.tensor(part, dtype=torch.float64) for part in parts)
    return past, control, later


def _learn_epoch(
    network: _Network, adam: torch.optim.Optimizer, sample: tuple[Sample, Tensor],
    p: ForecastSettings, generator: torch.Generator,
) -> None:  # fmt: skip
    """Show the network the whole sample once, in random batches and with noise on the past.

    sample: the training rows, and the weight (d,) of each state number's error.
    """
    (past, control, later), weight = sample
    size = min(p.batch_size, len(past))
    order = torch.randperm(len(past), generator=generator)
    for first in range(0, len(past) - size + 1, size):
        lot = order[first : first + size]
        noise = p.input_noise_sd * _draw_disturbances(past[lot].shape, generator)
        error = network(past[lot] + noise, control[lot]) - later[lot]
        loss = (error.square() * weight).mean()
        adam.zero_grad()
        loss.backward()
        adam.step()


def _draw_disturbances(shape: torch.Size, generator: torch.Generator) -> Tensor:
    """Draw noise (m, l, d) for the pasts: one shift common to all lags, and one for each lag."""
    m, lags, d = shape
    shift, each = (
        torch.randn(m, count, d, generator=generator, dtype=torch.float64) for count in (1, lags)
    )
    most = torch.rand(2, m, 1, 1, generator=generator, dtype=torch.float64)
    return most[0] * shift + most[1] * _STEADY * each


def _mean_square_errors(
    network: _Network, weight: Tensor, train: Sample, held_out: Sample
) -> dict[str, float]:
    """Return the mean square errors of training and held-out rows; 1 is that of no change.

    weight (d,): of each state number's error.
    """
    errors = {}
    with torch.inference_mode():
        for name, (past, control, later) in (("train", train), ("held_out", held_out)):
            square = (network(past, control) - later).square().mean(0)
            errors[f"{name}_error"] = float((square * weight).mean())
    return errors


def _copy_weights(network: _Network) -> dict[str, Tensor]:
    """Return a copy of the network's present weights, by name."""
    return {name: value.detach().clone() for name, value in network.state_dict().items()}


@contextmanager
def _torch_on_one_thread(seed: int) -> Iterator[torch.Generator]:
    """Run torch on one thread, so that sums are reproducible; the seed draws the first weights."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            yield torch.Generator().manual_seed(seed)
    finally:
        torch.set_num_threads(before)
