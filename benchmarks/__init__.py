"""Benchmarks of speed, memory and accuracy, no part of the tests. `make bench` runs them all."""
