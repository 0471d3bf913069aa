"""Machine code is used again only while every kernel is the same."""

import shutil
import subprocess
import sys

from conftest import ROOT


def test_a_kernel_is_compiled_again_when_one_that_it_calls_in_another_file_changes(tmp_path):
    base = tmp_path / "finloop/base"
    base.mkdir(parents=True)
    for name in ("finloop/__init__.py", "finloop/base/__init__.py"):
        (tmp_path / name).touch()
    shutil.copy(ROOT / "finloop/base/kernel.py", base)
    head = "from finloop.base.kernel import kernel\n"
    inner = head + "@kernel\ndef inner():\n    return {}\n"
    outer = (
        "from finloop.inner import inner\n" + head + "@kernel\ndef outer():\n    return inner()\n"
    )
    (tmp_path / "finloop/outer.py").write_text(outer)
    look = "from finloop.outer import outer; print(outer(), sum(outer.stats.cache_hits.values()))"
    values, hits = [], []
    for number in (1, 1, 2):
        (tmp_path / "finloop/inner.py").write_text(inner.format(number))
        printed = subprocess.check_output([sys.executable, "-c", look], cwd=tmp_path, text=True)
        value, hit = map(int, printed.split())
        values.append(value)
        hits.append(hit)
    assert values == [1, 1, 2]
    assert hits == [0, 1, 0]
