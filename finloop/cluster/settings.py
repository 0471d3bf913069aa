"""Parameters of `cluster`: where the work is done. No result depends on them, and no stage does."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

Address = Annotated[str, Field(pattern=r"^(tcp|tls)://\S+:\d+$")]


@dataclass(frozen=True)
class Default:
    """Processes of this machine, or the workers of a scheduler that runs already."""

    source: Literal["default"]
    scheduler_address: Address | None

    RENAMED: ClassVar = {"address": "scheduler_address"}


@dataclass(frozen=True)
class Local:
    """Dask's own workers on this machine, as many as there are threads."""

    source: Literal["local"]


ClusterSettings = Default | Local
