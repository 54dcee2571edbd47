# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""What accessvdb.tiles does after a tile's process has ended; no Dask, no processes, no files."""

from __future__ import annotations

import enum
import signal
from dataclasses import dataclass, field
from typing import Dict, List, Optional

from ._tile_task import Outcome

CRASH_RETRIES = 2
DISK_RETRIES = 1
_NEAR_LIMIT = 0.8  # killed above this part of its limit: for its memory
_LEAST_EDGE_VOXELS = 128


class Failure(enum.Enum):
    """Kinds of endings that differ in what to do."""

    MEMORY = enum.auto()
    CRASH = enum.auto()
    DEVICE = enum.auto()
    DISK = enum.auto()
    INPUT = enum.auto()


class Action(enum.Enum):
    """What to do with the tile, or with the whole run."""

    DONE = enum.auto()
    QUARTERS = enum.auto()
    RETRY = enum.auto()
    POISON = enum.auto()
    STOP = enum.auto()


EXIT_CODE = {Failure.MEMORY: 5, Failure.CRASH: 70, Failure.DEVICE: 6, Failure.DISK: 7}


def failure_of(outcome: Outcome) -> Optional[Failure]:
    """The kind of failure; None for a finished tile."""
    code = outcome["code"]
    if code > 128:
        code = 128 - code  # a shell or a container's way to say which signal it was
    if code == 0:
        return None if outcome["tiles"] else Failure.CRASH
    if code == 5:
        # A tool that is too large is as large for a quarter.
        return Failure.INPUT if str(outcome["error"].get("id", "")).startswith("tool.") else Failure.MEMORY
    if code == -signal.SIGKILL and not outcome["stalled"]:
        return Failure.MEMORY if outcome["peak_bytes"] > _NEAR_LIMIT * outcome["limit_bytes"] else Failure.CRASH
    # 126 and 127: the program is not there or does not start, which is the same for every tile.
    kinds = {2: Failure.INPUT, 3: Failure.INPUT, 4: Failure.INPUT, 6: Failure.DEVICE, 7: Failure.DISK,
             126: Failure.INPUT, 127: Failure.INPUT}  # fmt: skip
    return kinds.get(code, Failure.CRASH)


def exit_code_of(outcome: Outcome, failure: Failure) -> int:
    """Of the driver, if the run ends with this failure."""
    code = outcome["code"]
    if failure is Failure.INPUT:
        return code if code in (2, 3, 4, 5) else 2
    return EXIT_CODE[failure]


def in_words(outcome: Outcome) -> str:
    """The ending in a few words, for one line."""
    code = outcome["code"]
    if outcome["stalled"]:
        return f"used no processor time for long and was ended, on {outcome['host']}"
    error = outcome["error"]
    if error:
        subject = str(error.get("subject", ""))
        about = f"{subject}: " if subject and subject != f"tile {outcome['tile']}" else ""
        text = f"{about}{error.get('problem', '')} ({error.get('id', '')})"
    elif code < 0:
        text = f"killed by {_signal_name(-code)}"
        if code == -signal.SIGKILL:
            text += f" at {outcome['peak_bytes'] >> 20} of {outcome['limit_bytes'] >> 20} MiB"
    elif code == 0:
        text = "ended without a result"
    else:
        text = f"exit code {code}" + (f", {outcome['tail']}" if outcome["tail"] else "")
    return f"{text}, on {outcome['host']}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


@dataclass(frozen=True)
class Grid:
    """Sizes from plan.json that say which tiles can be split."""

    tile_voxels: int
    margin_voxels: int
    whole: bool = False  # --change full takes whole tiles

    def quarters(self, tile: str) -> List[str]:
        """Names of the quarters; none where they would be smaller than the tool allows."""
        whole, _, digits = tile.partition(".")
        edge = (self.tile_voxels >> len(digits)) // 2
        if self.whole or edge < max(_LEAST_EDGE_VOXELS, 2 * self.margin_voxels):
            return []
        return [f"{whole}.{digits}{digit}" for digit in "0123"]


@dataclass
class Ledger:
    """Counts failures of each tile and decides."""

    grid: Grid
    crashes: Dict[str, int] = field(default_factory=dict)
    disk_failures: Dict[str, int] = field(default_factory=dict)

    def judge(self, outcome: Outcome) -> Action:
        """What to do after this ending of a tile's process."""
        tile, failure = outcome["tile"], failure_of(outcome)
        if failure is None:
            return Action.DONE
        if failure is Failure.INPUT:
            return Action.STOP
        if failure is Failure.MEMORY:
            return Action.QUARTERS if self.grid.quarters(tile) else Action.POISON
        if failure is Failure.DISK:
            self.disk_failures[tile] = self.disk_failures.get(tile, 0) + 1
            return Action.RETRY if self.disk_failures[tile] <= DISK_RETRIES else Action.STOP
        self.crashes[tile] = self.crashes.get(tile, 0) + 1
        return Action.RETRY if self.crashes[tile] <= CRASH_RETRIES else Action.POISON
