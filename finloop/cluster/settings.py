"""Parameters of `cluster`: where the work is done. No result depends on them, and no stage does."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

Address = Annotated[str, Field(pattern=r"^(tcp|tls)://\S+:\d+$")]


@dataclass(frozen=True)
class Default:
    """Processes of this machine, or the workers of a scheduler that runs already."""

    source: Literal["default"]  # this variant
    # of Dask's scheduler, such as tcp://host:8786; null: processes of this machine, without Dask
    address: Address | None


@dataclass(frozen=True)
class Local:
    """Dask's own workers on this machine, as many as there are threads."""

    source: Literal["local"]  # this variant


ClusterSettings = Default | Local
