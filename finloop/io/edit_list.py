"""The edit list of a mode, as the stages `modes-…` and `retarget` write it."""

from pathlib import Path

import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.schema import Schema
from finloop.io.table import load_table


def load_edit(folder: Path, mode: str, stage: str, schema: Schema) -> pd.DataFrame:
    """Load the edit list `folder`/`mode`.parquet as a table with the columns of `schema`.

    stage: for messages, which name the parameter `stage`.mode. FinloopError if the file is missing
    or damaged.
    """
    path = folder / f"{mode}.parquet"
    if not path.exists():
        raise FinloopError(
            f"there is no {path}: the stage that makes it has not run",
            f"an edit list of the mode that {stage}.mode names",
            "make it: dvc repro",
        )
    return load_table(path, schema)
