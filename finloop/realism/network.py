"""A small convolutional network that distinguishes crops of film and animation, block by block.

Three layers (Zeiler & Fergus 2014 have more: here a second of training must do), the mean over the
place of their last answer, one score. It learns in the same blocks as the other classifier. Crops
are mirrored about the fish's axis at random, since left and right are alike.
"""

from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask
from finloop.realism.auc import Scores
from finloop.realism.classifier import learnable_blocks
from finloop.realism.crops import SIZE
from finloop.realism.settings import RealismSettings
from finloop.realism.windows import Windows, join_windows

if TYPE_CHECKING:
    from torch import Tensor, nn

Part = Literal[0, 1]
"""What of a crop the network sees: 0 the crop, 1 its change from the tick before."""

_BATCH = 64  # crops per step of learning, half of them animation
_RATE, _DECAY = 4e-3, 1e-2
_LARGEST = 6.0  # SDs; a pixel that differs by more counts as this
_OBVIOUS = 8  # crops per block whose important pixels are averaged


def score_held_out_crops(
    film: Windows, animation: Windows, part: Part, p: RealismSettings
) -> tuple[Scores, Floats]:
    """Train a network per block of time; return the scores of the crops in it, and where it looks.

    film, animation: crops as windows of one tick, x (n, 2, SIZE²). The second result is the mean of
    |gradient × pixel| over the animation crops with the highest scores (SIZE, SIZE); its sum is 1,
    or 0 if no block could be learnt.
    """
    import torch  # not at the top: the import takes seconds, and plots do not need it

    both = join_windows([film, animation])
    is_animation = np.arange(len(both)) >= len(film)
    score, looks = np.full(len(both), np.nan), np.zeros((SIZE, SIZE))
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # so that sums are reproducible
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(p.seed)
            x = torch.from_numpy(both.x[:, part].reshape(-1, 1, SIZE, SIZE).astype(np.float32))
            for learn, test in learnable_blocks(both, is_animation):
                unit = _LARGEST * x[learn].std() + 1e-6
                shown = (x / unit).clamp(-1, 1) * _LARGEST
                network = _train(
                    shown, learn & ~is_animation, learn & is_animation, p.classifier_trees
                )
                with torch.no_grad():
                    score[test] = network(shown[test])[:, 0].numpy()
                order = np.argsort(np.where(test & is_animation, score, -np.inf))[::-1]
                obvious = order[: min(_OBVIOUS, int((test & is_animation).sum()))].copy()
                looks += _important_pixels(network, shown[obvious])
    finally:
        torch.set_num_threads(threads)
    labels = is_animation, both.block, both.cluster
    return Scores(score, *labels), looks / max(looks.sum(), 1e-12)


def _train(shown: "Tensor", film: Mask, animation: Mask, rounds: int) -> "nn.Module":
    """Return a network that has learnt to distinguish crops (n, 1, SIZE, SIZE).

    film, animation: masks (n,) of the crops that it learns from; every step sees as many of both.
    rounds: steps.
    """
    import torch
    from torch import nn

    sizes = 1, 8, 16, 32
    layers = list[nn.Module]()
    for before, after in pairwise(sizes):
        kernel, stride = (7, 4) if before == 1 else (3, 2)
        layers += [nn.Conv2d(before, after, kernel, stride, kernel // 2), nn.ReLU()]
    network = nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(32, 1))
    adam = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(adam, _RATE, total_steps=rounds)
    sets = [torch.from_numpy(np.flatnonzero(mask)) for mask in (film, animation)]
    wanted = torch.repeat_interleave(torch.tensor([0.0, 1.0]), _BATCH // 2)[:, None]
    for _ in range(rounds):
        chosen = torch.cat([rows[torch.randint(len(rows), (_BATCH // 2,))] for rows in sets])
        batch = shown[chosen]
        flipped = torch.rand(_BATCH) < 0.5
        batch[flipped] = batch[flipped].flip(2)
        adam.zero_grad()
        nn.functional.binary_cross_entropy_with_logits(network(batch), wanted).backward()
        adam.step()
        schedule.step()
    return network


def _important_pixels(network: "nn.Module", crops: "Tensor") -> NDArray[np.float64]:
    """Return the sum of |gradient of the score × pixel| over crops (n, 1, SIZE, SIZE)."""
    import torch

    crops = crops.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(network(crops).sum(), crops)
    return np.asarray((gradient * crops).abs().sum((0, 1)).detach().numpy(), float)
