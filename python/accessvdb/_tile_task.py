# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""What a Dask worker does for accessvdb.tiles: one tile, by the process `accessvdb tile run --worker` of its slot.

A process of its own, because one that runs out of memory or loses its GPU must not take the worker and its other tiles
along. It goes on to the next tile after one that was finished, because starting it, most of all with a GPU, costs more
than many tiles do; after any other ending the next tile gets a new one. This file travels to the workers by value and
imports nothing of the package: a worker needs Dask and the program.
"""

from __future__ import annotations

import importlib
import json
import os
import select
import shutil
import socket
import subprocess
import threading
import time
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple, TypedDict

_POLL_S = 0.1  # how often a process is looked at: at 1 GB/s its memory grows by a tenth of a gigabyte
_UNWANTED_POLL_S = 0.5
_STOP_S = 20.0  # for a process that was asked to stop; it looks between steps and removes what is half-written
_TAIL_BYTES = 8192


class Request(TypedDict):
    """What a worker is asked to do."""

    run: str  # of the driver; a process serves one run, which has one plan
    out: str
    tile: str
    program: str  # where the driver found it; another host may have it elsewhere
    threads: int
    max_memory: str  # as for --max-memory; empty: what the machine has
    device: str  # empty: the program's default
    gpu_of_worker: Dict[str, str]  # CUDA_VISIBLE_DEVICES by the name of the worker
    stall_s: float  # a process that has used no processor time for so long is ended


class Outcome(TypedDict):
    """How it ended."""

    tile: str
    code: int  # exit code; minus the signal's number for a process that was killed
    error: Dict[str, Any]  # the program's error: id, subject, problem, advice; empty without one
    tail: str  # last line of stderr
    tiles: List[Dict[str, Any]]  # manifests of the finished tile, or of its quarters
    peak_bytes: int  # resident memory during this tile, last known
    limit_bytes: int
    stalled: bool
    host: str
    slot: str  # worker and thread: runs one tile at a time
    began: float  # time.time() of this host when the tile began, and when it had ended
    ended: float


def find_program(hint: str = "") -> Optional[str]:
    """The program `accessvdb`: $ACCESSVDB_PROGRAM, then the hint, then PATH."""
    named = os.environ.get("ACCESSVDB_PROGRAM")
    if named:
        return shutil.which(named)
    return (shutil.which(hint) if hint else None) or shutil.which("accessvdb")


def available_bytes() -> int:
    """Memory that can still be had on this machine or in this container."""
    meminfo = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
    best = int(meminfo["MemAvailable"].split()[0]) * 1024
    for limit, used in (
        ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
        ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ):
        try:
            best = min(best, max(0, int(Path(limit).read_text()) - int(Path(used).read_text())))
        except (OSError, ValueError):  # no such group, or "max"
            pass
    return best


def bytes_of(text: str) -> int:
    """The number in --max-memory: bytes, or with K, M, G, T for powers of 1024. The program checks the text itself."""
    number = text.strip().upper().rstrip("IB")
    factor = 1024 ** ("KMGT".find(number[-1:]) + 1) if number[-1:] in ("K", "M", "G", "T") else 1
    try:
        return int(float(number.rstrip("KMGT")) * factor)
    except ValueError:
        return 0


def manifests(out: str, tile: str) -> List[Dict[str, Any]]:
    """What tile.json says of a finished tile, or of the quarters that it was run as; empty if there is none."""
    tiles = Path(out, "tiles")
    try:
        return [json.loads((tiles / tile / "tile.json").read_text())]
    except (OSError, ValueError):
        pass
    if not (tiles / f"{tile}.split.json").exists():
        return []
    first = tile if "." in tile else tile + "."
    return [manifest for digit in "0123" for manifest in manifests(out, first + digit)]


def _forget_peak(pid: int) -> None:
    """From here on _peak_bytes() is that of the next tile."""
    try:
        Path(f"/proc/{pid}/clear_refs").write_text("5")
    except OSError:  # not in every container; then it is that of the largest tile so far
        pass


def _peak_bytes(pid: int) -> int:
    """Of the process alone. What wait4() counts includes the memory of this worker, from before the exec."""
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return 0


def _processor_ticks(pid: int) -> int:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return -1
    return int(fields[11]) + int(fields[12])


class _Task:
    """Dask's view of the running task: who runs it, and whether anybody still waits for it."""

    def __init__(self) -> None:
        self._worker: Any = importlib.import_module("distributed").get_worker()
        self._key = self._worker.get_current_task()

    @property
    def worker(self) -> str:
        return str(self._worker.name)

    @property
    def slot(self) -> str:
        return f"{self._worker.address}/{threading.get_ident()}"

    def waiting(self) -> Dict[int, Tuple[str, Any]]:
        """The processes that wait for a tile, by the thread of their slot, each with the run that it is of. They are
        kept with the worker, because this module is a new one in each task."""
        if not hasattr(self._worker, "accessvdb_waiting"):
            self._worker.accessvdb_waiting = {}
        return self._worker.accessvdb_waiting  # type: ignore[no-any-return]

    def unwanted(self) -> bool:
        """Whether the task was cancelled, the driver died, or the worker is closing. Dask cannot stop a thread."""
        try:
            if self._worker.status.name in ("closing", "closed", "failed"):
                return True
            task = self._worker.state.tasks.get(self._key)
        except AttributeError:  # another version of Dask: the tile is finished for nothing, which does no harm
            return False
        return task is None or task.state == "cancelled"


class _Child:
    """One process `accessvdb tile run --worker`. It ends when this end of its standard input closes, whatever closes it,
    and by itself if no tile comes for some seconds."""

    def __init__(self, command: List[str], environment: Dict[str, str]) -> None:
        # A session of its own: Ctrl-C in the driver's terminal is for the driver to handle.
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
            start_new_session=True,
        )
        assert self.process.stdin is not None and self.process.stdout is not None and self.process.stderr is not None
        self._stdin, self._stdout, self._stderr = self.process.stdin, self.process.stdout, self.process.stderr
        threading.Thread(target=self.process.wait, daemon=True).start()  # one that ends by itself leaves no zombie
        self._open = [self._stdout.fileno(), self._stderr.fileno()]
        self.stdout = self.stderr = b""
        self.peak_bytes = 0
        self.stalled = False
        self._kill_at = float("inf")
        self._ticks = -1
        self._ticks_at = 0.0

    def run(self, tile: str, stall_s: float, task: _Task) -> Optional[int]:
        """@return 0: finished, and the process waits for the next; else its exit code; None: it had ended before"""
        self.stdout = self.stderr = b""
        self.peak_bytes, self._ticks, self._ticks_at = 0, -1, time.monotonic()
        _forget_peak(self.process.pid)
        try:
            self._stdin.write(f"{tile}\n".encode())
            self._stdin.flush()
        except OSError:
            self._wait(stall_s, task)  # what it has said on stderr is not lost
            return None
        self._wait(stall_s, task, tile)
        if self._finished(tile):
            return 0
        code = int(self.process.returncode)
        # One that has waited for long may end at the very moment at which it is asked.
        left = code == 0 and not self.stdout and not self.stderr and self._kill_at == float("inf")
        return None if left else code

    def _finished(self, tile: str) -> bool:
        return tile in self.stdout.decode(errors="replace").splitlines()

    def _wait(self, stall_s: float, task: _Task, tile: str = "") -> None:
        """Until the tile is finished or the process has ended."""
        unwanted_at = time.monotonic() + _UNWANTED_POLL_S
        while self.process.poll() is None:
            self._read(_POLL_S)
            self.peak_bytes = max(self.peak_bytes, _peak_bytes(self.process.pid))
            if tile and self._finished(tile):
                return
            now = time.monotonic()
            if now >= unwanted_at and self._kill_at == float("inf"):
                unwanted_at = now + _UNWANTED_POLL_S
                if task.unwanted():
                    self._stop()
            self._end_if_stalled(now, stall_s)
            if now >= self._kill_at:
                self.process.kill()
        while self._read(0):
            pass

    def _read(self, seconds: float) -> bool:
        """What has come on stdout and stderr, after a short wait. @return False if nothing has, or both have ended"""
        if not self._open:
            try:
                self.process.wait(seconds)
            except subprocess.TimeoutExpired:
                pass
            return False
        ready = select.select(self._open, [], [], seconds)[0]
        for pipe in ready:
            chunk = os.read(pipe, 65536)
            if not chunk:
                self._open.remove(pipe)
            elif pipe == self._stderr.fileno():
                self.stderr = (self.stderr + chunk)[-_TAIL_BYTES:]
            else:
                self.stdout = (self.stdout + chunk)[-_TAIL_BYTES:]
        return bool(ready)

    def _end_if_stalled(self, now: float, stall_s: float) -> None:
        ticks = _processor_ticks(self.process.pid)
        if ticks != self._ticks:
            self._ticks, self._ticks_at = ticks, now
        elif now - self._ticks_at > stall_s:
            self.stalled = True
            self.process.kill()

    def _stop(self) -> None:
        self._stdin.close()
        self._kill_at = time.monotonic() + _STOP_S

    def close(self) -> None:
        """Ends it, if it has not ended: soon, because it only waits."""
        for pipe in (self._stdin, self._stdout, self._stderr):
            try:
                pipe.close()
            except OSError:  # a line that it did not take
                pass
        try:
            self.process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self.process.kill()


def _error_in(stderr: str) -> Dict[str, Any]:
    for line in reversed(stderr.splitlines()):
        try:
            message = json.loads(line)
        except ValueError:
            continue
        if isinstance(message, dict) and message.get("level") == "error":
            return message
    return {}


def _command(program: str, request: Request) -> List[str]:
    command = [program, "tile", "run", request["out"], "--worker", "--error-format", "json"]
    command += ["--threads", str(request["threads"])]
    if request["max_memory"]:
        command += ["--max-memory", request["max_memory"]]
    if request["device"]:
        command += ["--device", request["device"]]
    return command


def _run(request: Request, outcome: Outcome, task: _Task, program: str) -> None:
    """Fills in how the tile ended, and keeps the process if it can go on."""
    environment = dict(os.environ)
    if task.worker in request["gpu_of_worker"]:
        environment["CUDA_VISIBLE_DEVICES"] = request["gpu_of_worker"][task.worker]
    waiting, slot = task.waiting(), threading.get_ident()
    run, child = waiting.pop(slot, ("", None))
    code = None
    if child is not None and run == request["run"]:
        code = child.run(request["tile"], request["stall_s"], task)
    if code is None:
        if child is not None:
            child.close()
        try:
            child = _Child(_command(program, request), environment)
        except OSError as error:
            outcome["tail"] = f"{program} on {outcome['host']}: {error.strerror}"
            return
        code = child.run(request["tile"], request["stall_s"], task)
    stderr = child.stderr.decode(errors="replace")
    outcome["code"] = int(child.process.returncode) if code is None else code
    outcome["error"] = _error_in(stderr)
    outcome["tail"] = (stderr.strip().splitlines() or [""])[-1][:400]
    outcome["peak_bytes"] = child.peak_bytes
    outcome["stalled"] = child.stalled
    if outcome["code"] == 0:
        outcome["tiles"] = manifests(request["out"], request["tile"])
    if child.process.poll() is None:
        waiting[slot] = (request["run"], child)
    else:
        child.close()
    outcome["ended"] = time.time()


def run_tile(request: Request) -> Outcome:
    """Runs one tile in a process that serves only this slot. Whatever goes wrong is part of the result."""
    task = _Task()
    outcome: Outcome = {
        "tile": request["tile"],
        "code": 127,
        "error": {},
        "tail": "",
        "tiles": [],
        "peak_bytes": 0,
        "limit_bytes": bytes_of(request["max_memory"]) or available_bytes(),
        "stalled": False,
        "host": socket.gethostname(),
        "slot": task.slot,
        "began": time.time(),
        "ended": time.time(),
    }
    program = find_program(request["program"])
    if program is None:
        outcome["tail"] = f"the program accessvdb is not on {outcome['host']}"
    else:
        _run(request, outcome, task, program)
    return outcome
