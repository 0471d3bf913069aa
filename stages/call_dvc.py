"""The command `dvc`, in a process that ends with its parent: `python -m stages.call_dvc status`."""

import stages.run  # noqa: F401  # isort: skip  (before all: a stage server may take it over)

import gc
import sys

from finloop.base.process import die_with_parent

if __name__ == "__main__":
    from dvc.cli import main

    die_with_parent()
    gc.disable()  # it is short and makes many small objects: collection takes a sixth of its time
    sys.exit(main())
