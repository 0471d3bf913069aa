"""Speed, memory and accuracy, measured; never part of the tests. `make bench` runs all of it."""
