"""Hostile messages, and whether what hears them grows."""

import gc
import json

import numpy as np


class Runs:
    """A pickle that would run a program."""

    def __reduce__(self):
        return print, ("run",)


def change_letters(rng, text):
    """A text with up to three letters changed."""
    content = bytearray(text.encode())
    for _ in range(int(rng.integers(4))):
        content[rng.integers(len(content))] = rng.integers(32, 127)
    return content.decode()


def hostile_messages(count, seed, good, bad=()):
    """Bad texts, good values as JSON with letters changed, and random bytes, at random."""
    rng, texts = np.random.default_rng(seed), [json.dumps(one) for one in good]
    for _ in range(count):
        kind = rng.integers(4)
        if kind == 0 and bad:
            yield bad[rng.integers(len(bad))]
        elif kind == 1:
            yield rng.bytes(int(rng.integers(1, 700)))
        else:
            yield change_letters(rng, texts[rng.integers(len(texts))])


def count_objects(rounds):
    """The number of objects after each round of a generator; those from before do not count."""
    counts = []
    gc.collect()
    gc.freeze()  # not looked through again
    try:
        for _ in rounds:
            gc.collect()
            counts.append(len(gc.get_objects()))
    finally:
        gc.unfreeze()
    return counts
