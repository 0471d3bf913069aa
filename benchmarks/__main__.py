"""All benchmarks, one after the other: `python -m benchmarks`, or `make bench`."""

from benchmarks import accuracy, memory, speed

if __name__ == "__main__":
    speed.main()
    memory.main()
    accuracy.main()
