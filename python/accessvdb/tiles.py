# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Runs the tiles of a large map on the cores of this machine, on several GPUs, or on many machines, by Dask.

    accessvdb tile plan OUT --scans scans/ --poses poses.txt --tool pruner.stl --voxel 0.02
    python3 -m accessvdb.tiles run OUT
    python3 -m accessvdb.tiles run OUT --scheduler tcp://head:8786

Needs the module `distributed` (Debian and Ubuntu: python3-distributed) and the program `accessvdb`, but not the compiled
part of this package. docs/large_maps.md, "Many machines", says how to start workers, and what is done after failures.
"""

from __future__ import annotations

import argparse
import os
import queue
import signal
import sys
import time
import uuid
from dataclasses import dataclass, field, replace
from typing import Any, Dict, List, NoReturn, Optional, Sequence, Tuple

from . import _tile_task
from ._errors import Error, InvalidArgument
from ._tile_cluster import Cluster, ClusterOptions, open_cluster
from ._tile_folder import StepFailed, Steps, Stop, Stopped, no_other_writer, one_driver, program_here, read_grid
from ._tile_folder import forget_poison, mark_poison
from ._tile_policy import Action, Ledger, exit_code_of, failure_of, in_words
from ._tile_task import Outcome, Request

_POLL_S = 0.2
_NO_WORKER_NOTICE_S = 5.0
_CORES_PER_PROCESS = 4


@dataclass(frozen=True)
class RunOptions:
    """How to run the tiles; what to map is in OUT/plan.json."""

    out: str
    scheduler: Optional[str] = None  # tcp://HOST:PORT; None: a cluster in this process
    host: Optional[str] = None  # address of that cluster's scheduler, for workers of other machines; None: no port
    workers: Optional[int] = None  # processes at a time, here; None: one per 4 cores
    threads_per_worker: Optional[int] = None  # of a process; None: its share of the cores
    max_memory: Optional[str] = None  # of a process, as for the program; None: its share of what is free
    gpus: Tuple[str, ...] = ()  # CUDA_VISIBLE_DEVICES of the processes
    per_gpu: int = 1
    device: Optional[str] = None
    keep_rays: bool = False
    quiet: bool = False
    stall_s: float = 600.0  # a process that has used no processor time for so long counts as crashed


@dataclass
class Summary:
    """What a run did."""

    tiles: int = 0
    points: int = 0
    splits: int = 0
    retries: int = 0
    seconds: float = 0.0  # from the first tile to the last
    process_s: float = 0.0  # of all processes together, of which the tiles themselves took tile_s
    tile_s: float = 0.0
    gaps_s: List[float] = field(default_factory=list)  # from the end of a process to the start of the next on its slot
    failed: Dict[str, Tuple[int, str]] = field(default_factory=dict)  # exit code and reason of each poisoned tile

    def in_words(self) -> str:
        """One line."""
        text = f"mapped {self.tiles} tiles with {self.points} points in {self.seconds:.1f} s"
        if self.splits or self.retries:
            text += f" ({self.splits} split, {self.retries} retried)"
        if self.tiles:
            text += f"; per tile: {self.tile_s / self.tiles:.2f} s mapping"
            text += f", {max(0.0, self.process_s - self.tile_s) / self.tiles:.2f} s starting processes"
        if self.gaps_s:
            text += f", {sum(self.gaps_s) / len(self.gaps_s):.3f} s waiting for the engine"
        return text


class PoisonedTiles(Error):
    """Some tiles failed again and again; all others are finished."""


class _RunStopped(Error):
    """The rest of the run would fail too, or its input is wrong."""


class _Driver:
    """Submits tiles, judges how they end, and submits what is left to do about it."""

    def __init__(self, cluster: Cluster, request: Request, ledger: Ledger, steps: Steps) -> None:
        self._cluster = cluster
        self._request = request
        self._ledger = ledger
        self._steps = steps
        self._run = uuid.uuid4().hex[:8]
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._running: Dict[Any, str] = {}  # tile of each future
        self._slot_ended: Dict[str, float] = {}
        self._submitted = self._settled = 0
        self.summary = Summary()

    def run(self, tiles: Sequence[str]) -> Summary:
        begin = time.monotonic()
        try:
            for tile in tiles:
                self._submit(tile)
            while self._running:
                self._judge(self._next())
        except BaseException:
            self._cluster.cancel(list(self._running))
            raise
        finally:
            self.summary.seconds = time.monotonic() - begin
        order = {tile: n for n, tile in enumerate(tiles)}
        # Not in the order in which they failed, which is another one each time; what was asked for comes before quarters.
        by_order = sorted(self.summary.failed.items(), key=lambda item: (order.get(item[0], len(order)), item[0]))
        self.summary.failed = dict(by_order)
        return self.summary

    def _submit(self, tile: str, priority: int = 0) -> None:
        request = dict(self._request, tile=tile)
        run_tile = _tile_task.run_tile

        # Dask sends functions of modules by name, and workers need not have this module; a local one goes by value.
        def task() -> Outcome:
            return run_tile(request)  # type: ignore[arg-type]

        self._submitted += 1
        future = self._cluster.submit(task, f"tile-{tile}-{self._submitted}-{self._run}", priority)
        self._running[future] = tile
        future.add_done_callback(self._ended.put)

    def _next(self) -> Any:
        notice_at = time.monotonic() + _NO_WORKER_NOTICE_S
        while True:
            try:
                return self._ended.get(timeout=_POLL_S)
            except queue.Empty:
                pass
            if self._steps.stop.signal:
                raise Stopped
            if time.monotonic() > notice_at:
                notice_at = float("inf")
                if not self._cluster.has_workers():
                    self._steps.say("no worker has joined yet; docs/large_maps.md says how to start some")

    def _judge(self, future: Any) -> None:
        tile = self._running.pop(future, None)
        if tile is None:
            return
        outcome = self._cluster.result(future)
        if outcome is None:
            self._poison(tile, 70, "its worker died each time")
            return
        self._count(outcome)
        action, failure = self._ledger.judge(outcome), failure_of(outcome)
        if action is Action.DONE or failure is None:
            self._say_done(outcome)
            return
        code, words = exit_code_of(outcome, failure), in_words(outcome)
        if action is Action.RETRY:
            self.summary.retries += 1
            self._steps.say(f"tile {tile} is run again: {words}")
            self._submit(tile, priority=1)
        elif action is Action.QUARTERS:
            self.summary.splits += 1
            self._steps.say(f"tile {tile} is run as quarters: {words}")
            for quarter in self._ledger.grid.quarters(tile):
                self._submit(quarter, priority=1)
        elif action is Action.POISON:
            self._poison(tile, code, words)
        else:
            raise _stopped_by(outcome, code)

    def _count(self, outcome: Outcome) -> None:
        before = self._slot_ended.get(outcome["slot"])
        if before is not None:
            self.summary.gaps_s.append(max(0.0, outcome["began"] - before))
        self._slot_ended[outcome["slot"]] = outcome["ended"]
        self.summary.process_s += outcome["ended"] - outcome["began"]

    def _say_done(self, outcome: Outcome) -> None:
        self._settled += 1
        for tile in outcome["tiles"]:
            self.summary.tiles += 1
            self.summary.points += int(tile.get("points", 0))
            self.summary.tile_s += float(tile.get("seconds", 0))
            self._steps.say(
                f"tile {tile.get('tile')} ({self._settled} done, {len(self._running)} left): {tile.get('points')} points "
                f"from {tile.get('returns')} returns in {float(tile.get('seconds', 0)):.1f} s, on {outcome['host']}"
            )

    def _poison(self, tile: str, code: int, words: str) -> None:
        self.summary.failed[tile] = (code, words)
        mark_poison(self._request["out"], tile, code, words)
        self._steps.say(f"tile {tile} is given up: {words}")


def _stopped_by(outcome: Outcome, code: int) -> Error:
    error = outcome["error"]
    made = _RunStopped(
        str(error.get("id") or "tile.failed"),
        str(error.get("subject") or f"tile {outcome['tile']}"),
        f"{error['problem']} (tile {outcome['tile']} on {outcome['host']})" if error else in_words(outcome),
        str(error.get("advice") or "All tiles would fail in the same way; run the same command again after that"),
    )
    made.code = code
    return made


def _poisoned(out: str, summary: Summary) -> Error:
    names = ", ".join(list(summary.failed)[:10]) + (", ..." if len(summary.failed) > 10 else "")
    code, words = next(iter(summary.failed.values()))
    count = len(summary.failed)
    made = PoisonedTiles(
        "tile.poison",
        out,
        f"{count} tile{'s' if count > 1 else ''} could not be mapped: {names} (the first: {words}); all others are finished",
        "The same command tries them again",
    )
    made.code = code
    return made


def _positive(name: str, value: Optional[int]) -> None:
    if value is not None and value < 1:
        raise InvalidArgument("usage.range", name, f"{value} is not 1 or more", "Leave it out for the default")


def _check(options: RunOptions) -> None:
    for name, value in (("--workers", options.workers), ("--threads-per-worker", options.threads_per_worker),
                        ("--per-gpu", options.per_gpu)):  # fmt: skip
        _positive(name, value)
    if not options.stall_s > 0:
        raise InvalidArgument("usage.range", "--stall-timeout", "is not above 0", "Give seconds")
    here = {"--workers": options.workers, "--gpus": options.gpus, "--host": options.host}
    for name, given in here.items():
        if options.scheduler and given:
            raise InvalidArgument("usage.conflict", name, "is for workers of this machine, but --scheduler has its own",
                                  "Say it where the workers are started: docs/large_maps.md shows how")  # fmt: skip
    if options.workers and options.gpus:
        raise InvalidArgument("usage.conflict", "--workers", "goes by --gpus times --per-gpu", "Leave it out")


def _shares(options: RunOptions) -> Tuple[int, Request]:
    """How many processes run here at a time, and what each is asked to do."""
    cores = len(os.sched_getaffinity(0))
    slots = options.workers or len(options.gpus) * options.per_gpu or max(1, cores // _CORES_PER_PROCESS)
    if options.scheduler:
        threads, memory = _CORES_PER_PROCESS, ""
    else:
        threads, memory = max(1, cores // slots), str(int(0.9 * _tile_task.available_bytes() / slots))
    request: Request = {
        "run": uuid.uuid4().hex,
        "out": options.out,
        "tile": "",
        "program": program_here(),
        "threads": options.threads_per_worker or threads,
        "max_memory": options.max_memory or memory,
        "device": options.device or ("cuda" if options.gpus else ""),
        "gpu_of_worker": {str(n): options.gpus[n % len(options.gpus)] for n in range(slots) if options.gpus},
        "stall_s": options.stall_s,
    }
    return slots, request


def run(options: RunOptions, stop: Optional[Stop] = None) -> Summary:
    """Everything that is left to do for the map in options.out: bin, all tiles, merge.

    Raises an accessvdb.Error: PoisonedTiles if tiles are left that fail each time, "output.locked" if another driver is
    at work, "scheduler.lost", and what the program itself reports. The same call goes on from there.
    `stop`: set its signal from a signal handler or another thread, and the call ends with the exception Stopped.
    """
    options = replace(options, out=os.path.abspath(options.out))
    _check(options)
    stop = stop or Stop()

    def say(text: str) -> None:
        if not options.quiet:
            print(f"accessvdb: {text}", file=sys.stderr, flush=True)

    grid = read_grid(options.out)
    slots, request = _shares(options)
    steps = Steps(request["program"], options.out, options.quiet, stop, say, options.max_memory or "")
    summary = Summary()
    with one_driver(options.out):
        todo = steps.todo()
        forget_poison(options.out)
        if todo:
            cluster = ClusterOptions(options.scheduler, options.host, slots)
            with no_other_writer(options.out), open_cluster(cluster, say) as opened:
                say(f"running {len(todo)} tiles, {opened.description}, {request['threads']} threads each")
                summary = _Driver(opened, request, Ledger(grid), steps).run(todo)
            say(summary.in_words())
        if summary.failed:
            steps.merge(True, partial=True)
            raise _poisoned(options.out, summary)
        steps.merge(options.keep_rays)
    say(f"done; one file of all points: accessvdb tile merge {options.out} --points all.ply")
    return summary


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        _say_error(InvalidArgument("usage.flag", "", message, "See python3 -m accessvdb.tiles run --help"))
        sys.exit(2)


def _parser() -> argparse.ArgumentParser:
    about = "A map in tiles on many cores, GPUs or machines, by Dask."
    parser = _Parser(prog="python3 -m accessvdb.tiles", description=about)
    run_parser = parser.add_subparsers(dest="step", required=True, metavar="run").add_parser(
        "run",
        help="bin, run all tiles that are left, merge",
        description="Does what is left of a map in tiles: accessvdb tile bin, run and merge. Stopped by whatever, the "
        "same command goes on.",
        epilog="Example: python3 -m accessvdb.tiles run out/ --workers 4 --max-memory 8G",
    )
    add = run_parser.add_argument
    add("out", metavar="OUT", help="folder of accessvdb tile plan; with other machines: the same path on all")
    add("--scheduler", metavar="tcp://HOST:PORT", help="of a running Dask cluster, instead of one in this process")
    add("--host", metavar="ADDRESS[:PORT]",
        help="listen here for workers of other machines; whoever reaches the port can run code (default: no port)")  # fmt: skip
    add("--workers", type=int, metavar="N", help="processes at a time (default: one per 4 cores)")
    add("--threads-per-worker", type=int, metavar="N", help="threads of a process (default: its share of the cores)")
    add("--max-memory", metavar="M", help="limit of each process, such as 8G (default: its share of what is free)")
    add("--gpus", metavar="0,1", default="", help="spread the processes over these GPUs")
    add("--per-gpu", type=int, default=1, metavar="N", help="processes at a time on each GPU (default: 1)")
    add("--device", choices=("auto", "cpu", "cuda"), help="where scoring runs (default: cuda with --gpus, else auto)")
    add("--keep-rays", action="store_true", help="keep the sorted returns")
    add("--stall-timeout", type=float, default=RunOptions.stall_s, metavar="SECONDS",
        help="end a process that has used no processor time for so long, and run its tile again (default: 600)")  # fmt: skip
    add("--quiet", action="store_true", help="only errors on stderr")
    return parser


def _say_error(error: Error) -> None:
    text = " ".join(str(error).split())
    print(f"accessvdb: error[{error.id}] {text}", file=sys.stderr, flush=True)


def _watch_signals(stop: Stop) -> None:
    """The first one asks for a stop; a second one ends the program at once, and its children with it."""

    def remember(number: int, _frame: Any) -> None:
        if stop.signal:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        stop.signal = number

    signal.signal(signal.SIGINT, remember)
    signal.signal(signal.SIGTERM, remember)


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """The command line. Returns the exit code of the program's table."""
    given = vars(_parser().parse_args(arguments))
    given.pop("step")
    given["gpus"] = tuple(gpu.strip() for gpu in given["gpus"].split(",") if gpu.strip())
    given["stall_s"] = given.pop("stall_timeout")
    stop = Stop()
    _watch_signals(stop)
    try:
        run(RunOptions(**given), stop)
        return 0
    except Stopped:
        print("accessvdb: stopped; the same command goes on from here", file=sys.stderr, flush=True)
        return 128 + stop.signal
    except StepFailed as failed:  # has said why itself
        return failed.code
    except Error as error:
        _say_error(error)
        return error.code


if __name__ == "__main__":
    sys.exit(main())
