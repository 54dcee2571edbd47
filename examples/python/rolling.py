# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # A flight without end
#
# The map of a long flight in bounded memory: tiles leave for a folder and come back, nothing is forgotten, and a run that is
# stopped, even killed, goes on after its last checkpoint. Run it twice to see that: the second time it flies on.
#
#     python3 rolling.py --metres 60
#     python3 rolling.py --metres 120

# %%
import argparse
from pathlib import Path
from typing import Tuple

import numpy as np
import numpy.typing as npt

import accessvdb

parser = argparse.ArgumentParser(description="Fly along a fence, in tiles.")
parser.add_argument("--folder", type=Path, default=Path("flight"), help="for the tiles; go on if they are there")
parser.add_argument("--metres", type=float, default=60, help="fly this far")
parser.add_argument("--memory-mb", type=int, default=256, help="of the tiles in memory")
parser.add_argument("--out", type=Path, default=Path("flight_map"), help="folder for the map at the end")
options, _ = parser.parse_known_args()  # a notebook has its own arguments

# %% [markdown]
# ## Scans
#
# A wall with a post in front of it every three metres. A real flight takes its scans and poses from where they come.

# %%
Array = npt.NDArray[np.float64]
METRES_PER_SCAN, RAYS, RANGE_M = 0.5, 6000, 8.0
WALL_X, POST_X, POST_EVERY, POST_RADIUS = 3.0, 2.6, 3.0, 0.1


def scan(number: int) -> Tuple[Array, Array]:
    """(N, 3) returns in the sensor's frame, and its (4, 4) pose, sensor to world. (0, 0, 0) means no return."""
    random = np.random.default_rng(seed=number)
    T_W_S = np.eye(4)
    T_W_S[:3, 3] = 0.0, METRES_PER_SCAN * number, 0.3
    yaw, pitch = random.uniform(-1.2, 1.2, RAYS), random.uniform(-0.7, 0.4, RAYS)
    rays = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        range_m = np.minimum(WALL_X / rays[:, 0], np.where(rays[:, 2] < 0, -1.3 / rays[:, 2], np.inf))
        middle = POST_EVERY * np.round(T_W_S[1, 3] / POST_EVERY)
        for y in middle + POST_EVERY * np.arange(-3, 4):  # |q + t ray - axis| = radius, seen from above
            dx, dy = -POST_X, T_W_S[1, 3] - y
            a = rays[:, 0] ** 2 + rays[:, 1] ** 2
            b = rays[:, 0] * dx + rays[:, 1] * dy
            t = (-b - np.sqrt(b * b - a * (dx * dx + dy * dy - POST_RADIUS**2))) / a
            range_m = np.where(t > 0, np.fmin(range_m, t), range_m)  # a miss is NaN, which fmin ignores
    range_m[range_m > RANGE_M] = 0
    return rays * range_m[:, None], T_W_S


# %% [markdown]
# ## The flight
#
# `resume=True` goes on after the checkpoint of a folder, and a note that you give to a checkpoint comes back with it: here, how
# many scans there were. Parameters and tools have to be the same.

# %%
tool = accessvdb.ToolGeometry.builtin("builtin:pruner")
again = options.folder.is_dir()
field = accessvdb.RollingField(
    [tool],
    {"tsdf": {"voxel_size_m": 0.05}},
    folder=options.folder,
    memory_limit_bytes=options.memory_mb * 1_000_000,
    resume=again,
)
first = int(field.note or 0)
print(f"goes on after scan {first}" if again else "begins")
for number in range(first, int(options.metres / METRES_PER_SCAN)):
    field.integrate_scan(*scan(number))
    field.update()
    if (number + 1) % 20 == 0:
        field.checkpoint(str(number + 1))
        status = field.status()
        print(
            f"{METRES_PER_SCAN * (number + 1):5.0f} m: {status['points']:7d} points,"
            f" {status['tiles_in_memory']} of {status['tiles']} tiles in {status['memory_bytes'] / 1e6:.0f} MB"
        )
        if status["memory_short"]:  # the farthest returns were left out, and what lies there blocks
            print(f"  too little memory: only {status['fitting_range_m']:.0f} m around the sensor fit")

# %% [markdown]
# ## The whole map
#
# With labels as of now, also of the tiles that are not in memory. The folder is one of `map --tiles`: `accessvdb tile merge` makes one file
# of it, and `accessvdb report` shows it.

# %%
snapshot = field.snapshot()
print({label: count for label, count in snapshot.counts.items() if count})
field.checkpoint(str(max(first, int(options.metres / METRES_PER_SCAN))))
if not options.out.exists():
    field.write(options.out)
    print("map:", options.out)
