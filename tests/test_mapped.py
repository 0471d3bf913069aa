"""Mapped arrays: round trips; what is no array of the kind that is wanted is said."""

import errno
import os

import numpy as np
import pytest

from finloop.base.errors import FinloopError
from finloop.io.atomic import whole_folder
from finloop.io.mapped import create_array, open_array, save_array

ROWS = np.arange(24, dtype=np.int64).reshape(6, 4)


def test_an_array_comes_back_and_what_is_written_into_it_stays_in_this_process(tmp_path):
    path = tmp_path / "a.npy"
    save_array(path, ROWS)
    back = open_array(path, (None, 4), "int64")
    assert np.array_equal(back, ROWS)
    assert [file.name for file in tmp_path.iterdir()] == ["a.npy"]
    back[0] = -1  # what is written into it stays in this process
    assert back[0].tolist() == [-1] * 4
    assert np.array_equal(open_array(path, ROWS.shape, "int64"), ROWS)


def test_a_new_array_is_in_the_folder_when_that_is_whole(tmp_path):
    with whole_folder(tmp_path / "out") as folder:
        made = create_array(folder / "a.npy", ROWS.shape, "int64")
        for row, values in enumerate(ROWS):
            made[row] = values
    assert np.array_equal(open_array(tmp_path / "out/a.npy", ROWS.shape, "int64"), ROWS)


@pytest.mark.parametrize(
    ("shape", "kind", "said"),
    [((7, 4), "int64", r"shape \(6, 4\)"), ((None,), "int64", r"shape \(6, 4\)"),
     ((6, 4), "float32", "of int64")],
)  # fmt: skip
def test_an_array_of_another_film_is_refused(tmp_path, shape, kind, said):
    save_array(tmp_path / "a.npy", ROWS)
    with pytest.raises(FinloopError, match=said):
        open_array(tmp_path / "a.npy", shape, kind)


def test_a_full_disk_is_an_error_before_anything_is_written(tmp_path, monkeypatch):
    """And not a signal amid the work, which a mapped page without room on the disk gives."""

    def full(_file, _start, size):
        assert size > 8 * 1000
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
    with pytest.raises(FinloopError, match="the disk is full"), whole_folder(tmp_path / "a") as to:
        create_array(to / "b.npy", (1000,), "float64")
    assert not list(tmp_path.iterdir())
