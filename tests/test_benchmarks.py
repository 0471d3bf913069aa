"""Benchmarks: memory that rises with the work, whatever the process that measures has held."""

import subprocess
import sys

import pytest

from benchmarks.pipeline import ROOT, peak_mib

HOLD = "held = b'x' * ({} << 20)"


def test_peak_memory_rises_with_what_a_process_holds():
    least, more, most = (peak_mib(ROOT, "-c", HOLD.format(size)) for size in (0, 100, 300))
    assert least < 60
    assert more - least == pytest.approx(100, abs=5)
    assert most - more == pytest.approx(200, abs=5)


def test_peak_memory_does_not_begin_at_that_of_the_process_that_asks():
    code = "from benchmarks.pipeline import *; print(peak_mib(ROOT, '-c', ''))"
    small, large = (
        float(subprocess.check_output([sys.executable, "-c", f"{hold}; {code}"], cwd=ROOT))
        for hold in ("pass", HOLD.format(500))
    )
    assert large == pytest.approx(small, abs=5)


def test_peak_memory_is_that_of_the_largest_process():
    """Also where the workers of a stage do the work."""
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {HOLD.format(200)!r}])"
    assert peak_mib(ROOT, "-c", code) > 200


def test_a_process_that_fails_has_no_peak():
    with pytest.raises(SystemExit, match="ZeroDivisionError"):
        peak_mib(ROOT, "-c", "1 / 0")
