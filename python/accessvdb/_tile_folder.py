# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The folder of a map in tiles as accessvdb.tiles sees it: its lock, its plan, and the steps before and after the tiles."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Iterator, List, Optional

from ._errors import Error, InputError, InvalidArgument, OutputError
from ._tile_policy import Grid
from ._tile_task import find_program


@dataclass
class Stop:
    """Set by the handler of SIGINT and SIGTERM, looked at between waits."""

    signal: int = 0


class Stopped(Exception):
    """A signal asked for the end."""


class StepFailed(Error):
    """A step's program has failed and has said why on stderr."""


def _step_failed(step: str, code: int) -> StepFailed:
    failed = StepFailed("tile.step", f"accessvdb tile {step}", f"has failed with code {code}, see its message")
    failed.code = code if code > 0 else 70
    return failed


def program_here() -> str:
    """The program for this machine: $ACCESSVDB_PROGRAM, then bin/accessvdb above this module, then PATH."""
    beside = [folder / "bin" / "accessvdb" for folder in Path(__file__).resolve().parents]
    hint = next((str(path) for path in beside if os.access(path, os.X_OK)), "")
    program = find_program(hint)
    if program is None:
        named = os.environ.get("ACCESSVDB_PROGRAM", "")
        raise InvalidArgument("program.missing", named or "accessvdb", "there is no such program",
                              "Install accessvdb, or name it in the variable ACCESSVDB_PROGRAM")  # fmt: skip
    return program


def read_grid(out: str) -> Grid:
    """The sizes in plan.json."""
    path = Path(out, "plan.json")
    try:
        plan = json.loads(path.read_text())
        whole = "change full" in str(plan.get("parameters", "")).splitlines()
        return Grid(int(plan["tile_voxels"]), int(plan["margin_voxels"]), whole)
    except OSError as error:
        raise InputError("plan.missing", str(path), f"cannot be read ({error.strerror})",
                         "Make a plan with accessvdb tile plan") from None  # fmt: skip
    except (ValueError, KeyError, TypeError):
        raise InputError("plan.damaged", str(path), "is not a plan of tiles", "Start again with --fresh") from None


def _lock(path: str, flags: int, kind: int, problem: str) -> int:
    """@return a descriptor that holds the lock; -1 where the file system has none"""
    try:
        descriptor = os.open(path, flags | os.O_CLOEXEC)
    except OSError as error:
        raise OutputError("output.permission", path, f"cannot be opened ({error.strerror})",
                          "Check the folder's permissions") from None  # fmt: skip
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
            return -1
        raise OutputError("output.locked", os.path.dirname(path) if path.endswith(".json") else path, problem,
                          "Wait for it, or stop it") from None  # fmt: skip
    return descriptor


@contextlib.contextmanager
def one_driver(out: str) -> Iterator[None]:
    """For the whole run. plan.json, because it is there, stays, and can be locked through NFS, which needs a file that
    is open for writing; and because the steps bin and merge lock the folder itself."""
    lock = _lock(os.path.join(out, "plan.json"), os.O_RDWR, fcntl.LOCK_EX, "another driver runs the tiles of this folder")
    try:
        yield
    finally:
        if lock >= 0:
            os.close(lock)


@contextlib.contextmanager
def no_other_writer(out: str) -> Iterator[None]:
    """While tiles run: `map`, `tile plan`, `bin` and `merge` take this lock alone and are refused."""
    lock = _lock(out, os.O_RDONLY | os.O_DIRECTORY, fcntl.LOCK_SH, "another process is writing into this folder")
    try:
        yield
    finally:
        if lock >= 0:
            os.close(lock)


def mark_poison(out: str, tile: str, code: int, reason: str) -> None:
    """Names a tile that is given up, for `accessvdb tile status` and OUT/report.json."""
    folder = Path(out, "tiles")
    new = folder / f".{tile}.poison.json.tmp"
    try:
        folder.mkdir(exist_ok=True)
        new.write_text(json.dumps({"tile": tile, "exit_code": code, "reason": reason}))
        new.rename(folder / f"{tile}.poison.json")
    except OSError as error:
        raise OutputError("output.write", str(new), f"cannot be written ({error.strerror})",
                          "Check the folder and the disk, then run again") from None  # fmt: skip


def forget_poison(out: str) -> None:
    """All tiles are to be tried again."""
    for mark in Path(out, "tiles").glob("*.poison.json"):
        if re.fullmatch(r"-?\d+_-?\d+(\.[0-3]+)?\.poison\.json", mark.name) and not mark.is_symlink():
            mark.unlink(missing_ok=True)


@dataclass
class Steps:
    """The steps around the tiles, each by the program itself."""

    program: str
    out: str
    quiet: bool
    stop: Stop
    say: Callable[[str], None]
    max_memory: str = ""  # of a process

    def todo(self) -> List[str]:
        """Names of the tiles that are left, in the order in which to run them. Sorts the returns first if needed."""
        names = self._list()
        if names is None:
            self._run("bin", *(["--max-memory", self.max_memory] if self.max_memory else []))
            names = self._list()
        if names is None:
            raise InputError("rays.missing", self.out, "holds no rays of this plan after tile bin", "Run it again")
        return names

    def merge(self, keep_rays: bool, partial: bool = False) -> None:
        """One result of all tiles, or of those that are finished."""
        self._run("merge", *(["--keep-rays"] if keep_rays else []), *(["--partial"] if partial else []))

    def _list(self) -> Optional[List[str]]:
        command = [self.program, "tile", "list", self.out, "--todo", "--error-format", "json"]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, start_new_session=True)
        if self.stop.signal:
            raise Stopped
        if done.returncode == 0:
            return done.stdout.split()
        if done.returncode == 3 and '"rays.missing"' in done.stderr:
            return None
        # Once more, for the text.
        subprocess.run(command[:-2], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True)
        raise _step_failed("list", done.returncode)

    def _run(self, step: str, *more: str) -> None:
        command = [self.program, "tile", step, self.out, *(["--quiet"] if self.quiet else []), *more]
        guard = shutil.which("setpriv")
        if guard:  # ends with this process, whatever kills it; started by the main thread, which lives as long
            command = [guard, "--pdeathsig", "TERM", *command]
        sys.stderr.flush()
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True)
        try:
            code = self._wait(child)
        except BaseException:  # KeyboardInterrupt, where no handler sets `stop`
            child.terminate()
            child.wait()
            raise
        if self.stop.signal:
            raise Stopped
        if code != 0:
            raise _step_failed(step, code)

    def _wait(self, child: subprocess.Popen[bytes]) -> int:
        asked = False
        while True:
            try:
                return child.wait(0.1)
            except subprocess.TimeoutExpired:
                if self.stop.signal and not asked:
                    child.terminate()
                    asked = True
