"""Machine code is used again only while every kernel is the same."""

import shutil
import subprocess
import sys

from conftest import ROOT

LOOK = """
import os
import sys
from pathlib import Path
import numba
sys.dont_write_bytecode = True  # within a second Python would take the old file for the new one
numba.njit(lambda: 0)()  # what numba loads when it first compiles, which takes seconds
for number in (1, 1, 2):
    Path("finloop/inner.py").write_text(Path("inner.txt").read_text().format(number))
    if not os.fork():  # a process that has seen no kernel of ours
        from finloop.outer import a_kind, outer
        print(outer(a_kind), sum(outer.stats.cache_hits.values()), flush=True)
        os._exit(0)
    assert os.wait()[1] == 0
"""


def test_a_kernel_is_compiled_again_when_one_that_it_calls_in_another_file_changes(tmp_path):
    base = tmp_path / "finloop/base"
    base.mkdir(parents=True)
    for name in ("finloop/__init__.py", "finloop/base/__init__.py"):
        (tmp_path / name).touch()
    shutil.copy(ROOT / "finloop/base/kernel.py", base)
    head = "from finloop.base.kernel import kernel\n"
    inner = (
        "from typing import NamedTuple\n" + head + "class Kind{0}(NamedTuple):\n    of: int\n"
        "a_kind = Kind{0}(1)\n@kernel\ndef inner():\n    return {0}\n"
    )  # a type, too, has another name
    outer = "from finloop.inner import a_kind, inner\n" + head
    outer += "@kernel\ndef outer(kind):\n    return inner() * kind.of\n"
    (tmp_path / "finloop/outer.py").write_text(outer)
    (tmp_path / "inner.txt").write_text(inner)
    printed = subprocess.check_output([sys.executable, "-c", LOOK], cwd=tmp_path, text=True)
    assert printed.splitlines() == ["1 0", "1 1", "2 0"]
