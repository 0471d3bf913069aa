"""All benchmarks, one after the other: `python -m benchmarks`, or `make bench`."""

from benchmarks import (
    accuracy,
    animate,
    bpn,
    curve,
    distance,
    memory,
    morph,
    puppet,
    render,
    speed,
    table2,
)

if __name__ == "__main__":
    for benchmark in (
        speed,
        memory,
        accuracy,
        bpn,
        distance,
        animate,
        render,
        puppet,
        curve,
        morph,
        table2,
    ):
        benchmark.main()
