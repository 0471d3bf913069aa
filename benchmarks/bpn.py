"""Speed of learning the motion model: the paper's 200 epochs on 4480 rows (70 s there, Table 2).

`python -m benchmarks.bpn` prints the table and writes benchmarks/bpn.csv. The peer, in turn in the
same run, is the usual way: the same steps by torch's autograd and SGD.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

from statistics import median

import numpy as np
import pandas as pd
import torch

from benchmarks.pipeline import write_table
from benchmarks.speed import PAIRS, time_call, time_pairs
from finloop.base.settings import settings
from finloop.bpn.back_propagation import draw_first_weights, split_layers, train_motion_model
from finloop.bpn.settings import BpnSettings

ROWS, HELD_OUT, PAPER_S = 4480, 1120, 70.0
PEER_EPOCHS = 2  # autograd is slow; both sides of its pair run this many


def random_training_rows(row_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random inputs and outputs of the network: their values do not change the time."""
    rng = np.random.default_rng(row_count)
    inputs = rng.uniform([0, -1, 0, -90], [1, 1, 2, 90], (row_count, 4))
    return inputs, np.column_stack([inputs[:, 0], inputs[:, 1].round()])


def train_by_finloop(settings: BpnSettings) -> None:
    """Train on one split as the stage does, with the errors after each epoch."""
    rows, held_out = random_training_rows(ROWS), random_training_rows(HELD_OUT)
    train_motion_model(*rows, held_out, settings, 0.2, np.random.default_rng(0))


def train_by_torch(settings: BpnSettings) -> None:
    """Train the same network by the same rule with torch.autograd and torch.optim.SGD."""
    rng = np.random.default_rng(0)
    weights = torch.from_numpy(draw_first_weights(settings.hidden_units, rng)).requires_grad_()
    first, second = split_layers(weights)
    optimiser = torch.optim.SGD([weights], lr=settings.learning_rate, momentum=settings.momentum)
    inputs, outputs = random_training_rows(ROWS)
    x = torch.from_numpy(np.column_stack([inputs, np.ones(ROWS)]))
    targets = torch.from_numpy(outputs)
    for _ in range(settings.epochs):
        for row in rng.permutation(ROWS).tolist():
            optimiser.zero_grad()
            hidden = torch.sigmoid(x[row] @ first.T)
            output = torch.sigmoid(hidden @ second[:, :-1].T + second[:, -1])
            (0.5 * (output - targets[row]).square().sum()).backward()
            optimiser.step()


def main() -> None:
    """Time both trainings; print and write the table."""
    full, short = (settings("bpn", epochs=epochs) for epochs in (200, PEER_EPOCHS))
    train_by_finloop(short)  # compiled
    full_s = median(time_call(lambda: train_by_finloop(full))[0] for _ in range(PAIRS))
    short_s, torch_s, ratio, _ = time_pairs(
        lambda: train_by_finloop(short), lambda: train_by_torch(short)
    )
    results = [
        ("200 epochs, 4480 rows / the paper's 70 s", full_s, PAPER_S, full_s / PAPER_S),
        (f"{PEER_EPOCHS} epochs, 4480 rows / autograd and SGD of torch", short_s, torch_s, ratio),
    ]
    table = pd.DataFrame(results, columns=["what", "ours_s", "theirs_s", "ratio"]).round(4)
    print(f"{200 * ROWS / full_s:.0f} steps/s")
    write_table(__file__, table)


if __name__ == "__main__":
    main()
