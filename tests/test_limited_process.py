"""Functions in a process of their own: results, errors, and what is too much."""

import os
from contextlib import closing
from pathlib import Path

import pytest

from finloop.base.limited_process import LimitedProcess, LimitExceededError


@pytest.fixture(scope="module")
def process():
    with closing(LimitedProcess(5, 1024)) as running:
        yield running


def test_it_returns_and_raises_what_the_function_does(process, capfd):
    assert process.call(sorted, [3, 1, 2]) == [1, 2, 3]
    with pytest.raises(ValueError, match="'x'"):
        process.call(int, "x")
    assert process.call(print, "what a function prints is no answer") is None
    assert capfd.readouterr() == ("", "")


def test_it_works_in_the_present_folder(process, tmp_path, monkeypatch):
    process.call(len, "")
    monkeypatch.chdir(tmp_path)
    assert process.call(Path.resolve, Path("a")) == tmp_path.resolve() / "a"


def test_a_call_that_takes_too_much_memory_or_ends_its_process_is_named(process):
    for function, argument in ((bytes, 2**31), (os._exit, 0), (eval, "b'a' * 2**31")):
        with pytest.raises(LimitExceededError):
            process.call(function, argument)
        assert process.call(abs, -1) == 1  # by another process
    with pytest.raises(TypeError, match="memoryview"):
        process.call(memoryview, b"no copy of it can be sent back")
    assert process.call(abs, -2) == 2
