"""Parameters of `cluster`: where the work is done. No result depends on them, and no stage does."""

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
    """A Dask cluster on this machine, started for the stage: a worker per thread of the machine."""

    source: Literal["local"]


ClusterSettings = DefaultWorkers | LocalWorkers
