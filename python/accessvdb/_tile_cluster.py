# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The few calls of Dask distributed that accessvdb.tiles needs, the same since 2022.12."""

from __future__ import annotations

import contextlib
import importlib
import logging
import tempfile
from dataclasses import dataclass
from typing import Any, Callable, Iterator, List, Optional, cast

from . import _tile_task
from ._errors import DeviceError, InternalError, InvalidArgument
from ._tile_task import Outcome

_CONNECT_S = 5
_RESULT_S = 60


class SchedulerLost(DeviceError):
    """The scheduler has gone, and with it the knowledge of what runs where."""


@dataclass(frozen=True)
class ClusterOptions:
    """Which cluster to use."""

    scheduler: Optional[str]
    host: Optional[str]
    slots: int


class Cluster:
    """A connection to a scheduler."""

    def __init__(self, client: Any, description: str) -> None:
        self._client = client
        self.description = description

    def submit(self, task: Callable[[], Outcome], key: str, priority: int) -> Any:
        """@return a future, with its method add_done_callback()"""
        return self._client.submit(task, key=key, priority=priority, pure=False)

    def result(self, future: Any) -> Optional[Outcome]:
        """Of an ended task; None if Dask has given up on it because its workers died."""
        if future.status == "cancelled":
            raise _lost(self._client)
        try:
            return cast(Outcome, future.result(timeout=_RESULT_S))
        except Exception as error:  # whatever Dask wraps
            kind = type(error).__name__
            if kind == "KilledWorker":
                return None
            if kind in ("CancelledError", "TimeoutError", "CommClosedError"):
                raise _lost(self._client) from None
            raise InternalError("dask.task", "Dask", f"the task could not be run ({kind}: {error})",
                                "Use the same versions of Python and Dask on all machines") from None  # fmt: skip

    def cancel(self, futures: List[Any]) -> None:
        """Tasks that wait are dropped, those that run see it and stop their processes."""
        with contextlib.suppress(Exception):
            self._client.cancel(futures)

    def has_workers(self) -> bool:
        """Whether anybody could run a task."""
        try:
            return bool(self._client.scheduler_info()["workers"])
        except Exception:  # not connected; the futures will tell
            return True


def _lost(client: Any) -> SchedulerLost:
    address = getattr(getattr(client, "scheduler", None), "address", "")
    return SchedulerLost("scheduler.lost", str(address), "the scheduler has gone; finished tiles stay",
                         "Start it again and run the same command")  # fmt: skip


def _modules() -> Any:
    try:
        distributed = importlib.import_module("distributed")
        cloudpickle = importlib.import_module("cloudpickle")
    except ImportError as error:
        raise InvalidArgument("dask.missing", "", f"Dask distributed cannot be imported ({error})",
                              "On Debian and Ubuntu: apt install python3-distributed") from None  # fmt: skip
    cloudpickle.register_pickle_by_value(_tile_task)
    return distributed


@contextlib.contextmanager
def open_cluster(options: ClusterOptions, say: Callable[[str], None]) -> Iterator[Cluster]:
    """Connects to the scheduler, or starts a cluster in this process."""
    distributed = _modules()
    # Dask's own log tells in many lines what becomes one error here. Each of its loggers has a level of its own.
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("distributed", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    if options.scheduler:
        yield from _connected(distributed, options.scheduler)
    else:
        yield from _embedded(distributed, options, say)


def _connected(distributed: Any, address: str) -> Iterator[Cluster]:
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DeviceError("scheduler.missing", address, f"no scheduler answers there ({reason})",
                          "Start it with dask-scheduler, and check address and network") from None  # fmt: skip
    try:
        yield Cluster(client, f"by the scheduler {address}")
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=2)


def _embedded(distributed: Any, options: ClusterOptions, say: Callable[[str], None]) -> Iterator[Cluster]:
    """Scheduler and workers as threads of this process: they only wait for children, and a child that dies takes no
    worker along. Without --host they talk through memory, so that there is no port that others could reach."""
    import_config = importlib.import_module("dask").config.set
    host, _, port = (options.host or "").rpartition(":") if ":" in (options.host or "") else (options.host or "", "", "")
    with tempfile.TemporaryDirectory(prefix="accessvdb-dask-") as scratch, import_config(
        {"distributed.scheduler.worker-saturation": 1.0}  # a tile waits at the scheduler until a slot is free
    ):
        cluster = distributed.LocalCluster(
            n_workers=options.slots,
            threads_per_worker=1,
            processes=False,
            host=host or None,
            scheduler_port=int(port or 0),
            protocol="tcp://" if host else "inproc://",
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            memory_limit=0,
            local_directory=scratch,
            silence_logs=logging.CRITICAL,
        )
        with cluster, distributed.Client(cluster, set_as_default=False) as client:
            if host:
                say(f"workers can join at {cluster.scheduler_address}; whoever reaches this port can run code here")
            try:
                yield Cluster(client, f"{options.slots} at a time")
            finally:  # what waits for another tile must not hold memory and GPU while they are merged
                for worker in list(cluster.workers.values()):
                    for _, child in list(getattr(worker, "accessvdb_waiting", {}).values()):
                        child.close()
