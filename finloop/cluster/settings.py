"""Parameters of `cluster`: where work is computed. No result depends on them."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

Address = Annotated[str, Field(pattern=r"^(tcp|tls)://\S+:\d+$")]


@dataclass(frozen=True)
class DefaultWorkers:
    """Processes of this machine, or the workers of a running Dask scheduler.

    scheduler_address: of that scheduler, such as tcp://host:8786; None = processes of this machine.
    """

    source: Literal["default"]
    scheduler_address: Address | None

    RENAMED: ClassVar = {"address": "scheduler_address"}


@dataclass(frozen=True)
class LocalWorkers:
    """A Dask cluster started on this machine for the stage, one worker per thread."""

    source: Literal["local"]


ClusterSettings = DefaultWorkers | LocalWorkers
