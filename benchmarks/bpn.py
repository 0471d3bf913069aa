"""Speed of learning the motion model: the paper's 200 epochs on 4480 rows (70 s there, Table 2).

`python -m benchmarks.bpn` prints the table and writes benchmarks/bpn.csv. Beside it, in turn in the
same run: the bare matrix products of the same batches in numpy, the limit for any code that calls
one kernel after the other; and the same steps by torch's own autograd and SGD, the usual way.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import numpy as np
import pandas as pd
import torch

from benchmarks.pipeline import ROOT
from benchmarks.speed import paired
from finloop.base.settings import settings
from finloop.bpn.back_propagation import forward, new_weights, train
from finloop.bpn.settings import Settings

ROWS, HELD_OUT, PAPER_S = 4480, 1120, 70.0
PEER_EPOCHS = 10  # autograd is slow; both sides of its pair run this many


def rows(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Made-up inputs and outputs: what they are does not change the time."""
    rng = np.random.default_rng(count)
    inputs = rng.uniform([0, -1, 0, -90], [1, 1, 2, 90], (count, 4))
    return inputs, np.column_stack([inputs[:, 0], inputs[:, 1].round()])


def ours(how: Settings) -> None:
    """What the stage does for one split: learning, with the errors after each epoch."""
    train(*rows(ROWS), rows(HELD_OUT), how, 0.2, np.random.default_rng(0))


def products(how: Settings) -> None:
    """The five products of every step, into memory that is there already; nothing else."""
    rng, batch, units = np.random.default_rng(0), how.batch_size, how.hidden + 1
    x, h, d = (rng.random((batch, width)) for width in (5, units, 2))
    first, second = rng.random((5, units)), rng.random((units, 2))
    o, dh, first_slope, second_slope = map(np.empty_like, (d, h, first, second))
    x_t, h_t, second_t = x.T, h.T, second.T
    for _ in range(how.epochs * ROWS // batch):
        np.matmul(x, first, out=h)
        np.matmul(h, second, out=o)
        np.matmul(d, second_t, out=dh)
        np.matmul(h_t, d, out=second_slope)
        np.matmul(x_t, dh, out=first_slope)


def autograd(how: Settings) -> None:
    """The same network and rule by torch.autograd and torch.optim.SGD."""
    rng = np.random.default_rng(0)
    weights = new_weights(how.hidden, rng).requires_grad_()
    rule = torch.optim.SGD([weights], lr=how.learning_rate, momentum=how.momentum)
    inputs, outputs = rows(ROWS)
    x = torch.from_numpy(np.column_stack([inputs, np.ones(ROWS)]))
    t = torch.from_numpy(outputs)
    for _ in range(how.epochs):
        order = torch.from_numpy(rng.permutation(ROWS))
        for lot in order.split(how.batch_size):
            rule.zero_grad()
            (0.5 * (forward(weights, x[lot]) - t[lot]).square().sum()).backward()
            rule.step()


def main() -> None:
    """Measure, print, write."""
    whole, part = (settings("bpn", epochs=epochs, device="cpu") for epochs in (200, PEER_EPOCHS))
    mine, bare, ratio, _ = paired(lambda: ours(whole), lambda: products(whole))
    short, usual, peer, _ = paired(lambda: ours(part), lambda: autograd(part))
    results = [
        ("200 epochs, 4480 rows / the paper's 70 s", mine, PAPER_S, mine / PAPER_S),
        ("200 epochs, 4480 rows / its bare products in numpy", mine, bare, ratio),
        (f"{PEER_EPOCHS} epochs, 4480 rows / autograd and SGD of torch", short, usual, peer),
    ]
    table = pd.DataFrame(results, columns=["what", "ours_s", "theirs_s", "ratio"]).round(4)
    print(f"{whole.batch_size} rows a step, {200 * ROWS // whole.batch_size / mine:.0f} steps/s")
    print(table.to_string(index=False))
    table.to_csv(ROOT / "benchmarks/bpn.csv", index=False)


if __name__ == "__main__":
    main()
