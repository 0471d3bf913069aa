"""The faults of the films, from the tables in which stages judge them."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from finloop.base.finding import FINDINGS_NAME, GOOD


def load_faults(folders: Iterable[Path]) -> pd.DataFrame:
    """Return the findings with another verdict than good, from the folders of stages that judge.

    Columns film ("" for a single film), what, measured, what to do. A folder without the table is
    passed over.
    """
    paths = [folder / FINDINGS_NAME for folder in folders]
    columns = ["film", "what", "verdict", "measured", "what to do"]
    tables = [pd.DataFrame(columns=columns, dtype=str)] + [
        pd.read_csv(path, dtype=str, keep_default_na=False).reindex(columns=columns, fill_value="")
        for path in paths
        if path.is_file()
    ]
    findings = pd.concat(tables, ignore_index=True)
    return findings[findings["verdict"] != GOOD].drop(columns="verdict")
