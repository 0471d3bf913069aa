"""See stages.sweep."""

from stages.run import run  # isort: skip  (before numpy)

from stages.sweep import main

if __name__ == "__main__":
    run(main)
