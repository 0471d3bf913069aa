"""The faults of the films, from the tables in which stages judge them."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from finloop.base.finding import FINDINGS_NAME, GOOD
from finloop.io.table import load_csv


def load_faults(folders: Iterable[Path]) -> pd.DataFrame:
    """Load the faults of the films: all findings whose verdict is not "good".

    folders: of the stages that judge films; one without a table of findings is skipped. The table
    has the columns film ("" for a single film), what, measured, what to do.
    """
    paths = [folder / FINDINGS_NAME for folder in folders]
    columns = ["film", "what", "verdict", "measured", "what to do"]
    tables = [pd.DataFrame(columns=columns, dtype=str)] + [
        load_csv(path, as_text=True).reindex(columns=columns, fill_value="")
        for path in paths
        if path.is_file()
    ]
    findings = pd.concat(tables, ignore_index=True)
    return findings[findings["verdict"] != GOOD].drop(columns="verdict")
