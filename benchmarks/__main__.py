"""All benchmarks, one after the other: `python -m benchmarks`, or `make bench`.

Each is a program of its own, as each sets its number of threads.
"""

import subprocess
import sys

NAMES = ("speed", "repair", "memory", "accuracy", "bpn", "distance", "animate", "render", "puppet",
         "curve", "morph", "forces", "table2")  # fmt: skip

if __name__ == "__main__":
    for name in NAMES:
        subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=True)
