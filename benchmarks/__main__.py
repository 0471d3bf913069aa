"""All benchmarks, one after the other: `python -m benchmarks`, or `make bench`."""

from benchmarks import accuracy, animate, bpn, memory, render, speed

if __name__ == "__main__":
    for benchmark in (speed, memory, accuracy, bpn, animate, render):
        benchmark.main()
