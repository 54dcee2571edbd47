# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # Which parts of a corner can a tool reach?
#
# Scans in, labels out, in NumPy. Run it as a script, or cell by cell in an editor that knows `# %%` (VS Code, Spyder,
# PyCharm, Jupyter with jupytext).
#
#     python3 map_a_corner.py                                           simulated scans
#     python3 map_a_corner.py --scans scans/ --poses scans/poses.txt    your own

# %%
import argparse
from pathlib import Path
from typing import Any, Iterator, Tuple

import numpy as np
import numpy.typing as npt

import accessvdb

parser = argparse.ArgumentParser(description="Map scans, count labels, draw a picture.")
parser.add_argument("--scans", help="a folder of scans; without it, scans are simulated")
parser.add_argument("--poses", help="poses of the scans, for example in TUM format")
parser.add_argument("--tool", default="builtin:pencil", help="builtin:pencil or builtin:pruner")
parser.add_argument("--voxel", type=float, default=0.04, help="edge of a voxel in metres")
parser.add_argument("--out", type=Path, default=Path("corner"), help="folder for the field and the picture")
options, _ = parser.parse_known_args()  # a notebook has its own arguments

# %% [markdown]
# ## Scans
#
# A scan is an (N, 3) array of returns in the sensor's frame and a (4, 4) pose, sensor to world. Here: a scanner walks past a
# house wall with three posts in front of it, one of them too close to the wall for a tool to come between.

# %%
Array = npt.NDArray[np.float64]
WALL_X = 3.0
POSTS = np.array([[2.2, -1.2, 0.12], [2.4, 0.3, 0.10], [2.86, 1.3, 0.10]])  # x, y, radius


def ranges(q: Array, rays: Array) -> Array:
    """How far each ray from q reaches: to the wall x = 3, the ground z = -1 or a post."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to_wall = np.where(rays[:, 0] > 0, (WALL_X - q[0]) / rays[:, 0], np.inf)
        to_ground = np.where(rays[:, 2] < 0, (-1.0 - q[2]) / rays[:, 2], np.inf)
        nearest = np.minimum(to_wall, to_ground)
        for x, y, radius in POSTS:  # |q + t ray - axis| = radius, seen from above
            dx, dy = q[0] - x, q[1] - y
            a = rays[:, 0] ** 2 + rays[:, 1] ** 2
            b = rays[:, 0] * dx + rays[:, 1] * dy
            t = (-b - np.sqrt(b * b - a * (dx * dx + dy * dy - radius * radius))) / a
            nearest = np.where(t > 0, np.fmin(nearest, t), nearest)  # a miss is NaN, which fmin ignores
    return np.asarray(nearest, np.float64)


def simulated_scans(frames: int = 16, rays_per_frame: int = 8000) -> Iterator[Tuple[npt.NDArray[Any], Array]]:
    random = np.random.default_rng(seed=1)
    for frame in range(frames):
        T_W_S = np.eye(4)
        T_W_S[:3, 3] = 0.0, -1.8 + 3.6 * frame / (frames - 1), 0.3
        yaw = random.uniform(-1.2, 1.2, rays_per_frame)
        pitch = random.uniform(-0.7, 0.4, rays_per_frame)
        rays = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1)
        points_S = rays * ranges(T_W_S[:3, 3], rays)[:, None]
        points_S[np.linalg.norm(points_S, axis=1) > 8] = 0  # (0, 0, 0) means no return
        yield points_S, T_W_S


def scans_of_files(scans: str, poses: str) -> Iterator[Tuple[npt.NDArray[Any], Array]]:
    for record in accessvdb.ScanSequence(scans, poses):
        yield record.points_S, record.T_W_S


# %% [markdown]
# ## The field

# %%
tool = accessvdb.ToolGeometry.builtin(options.tool)
field = accessvdb.AccessibilityField(tool, {"tsdf": {"voxel_size_m": options.voxel}})

for points_S, T_W_S in scans_of_files(options.scans, options.poses) if options.scans else simulated_scans():
    stats = field.integrate_scan(points_S, T_W_S)
    if stats.points_used == 0:
        print("a scan without a usable return:", stats.dropped)
field.update()  # scores what changed; can also be called between scans

# %% [markdown]
# ## Labels, as arrays

# %%
snapshot = field.snapshot()
print(f"{tool.name}, {len(snapshot)} surface points on {field.device_name}")
for label, count in snapshot.counts.items():
    print(f"  {label:<11} {count:6d}  {count / max(1, len(snapshot)):.1%}")
print("why not:", {reason: count for reason, count in snapshot.reasons.items() if count and reason != "none"})

reachable = snapshot.label == accessvdb.PointLabel.ACCESSIBLE
heights = snapshot.position_W[reachable][:, 2]
if len(heights):
    print(f"reachable between z = {heights.min():.2f} and {heights.max():.2f} m")

# %% [markdown]
# ## Questions about free space
#
# Could an arm of 3 cm radius be placed along these lines? `free` means that every voxel of it was seen to be free. The map knows
# the space near surfaces, not all that the rays crossed: the third line, in mid-air, is not known.

# %%
a_W = np.array([[2.72, -0.4, 0.2], [2.72, 0.3, 0.2], [0.5, 0.0, 0.2]])
b_W = np.array([[2.85, -0.4, 0.2], [3.20, 0.3, 0.2], [1.5, 0.0, 0.2]])
arms = field.query_along(a_W, b_W, 0.03)
for n in range(len(arms)):
    print(f"arm {n}: {'free' if arms.free[n] else 'collides' if arms.collision[n] else 'not known'}")

# %% [markdown]
# ## A picture, and files for Blender, Houdini and CloudCompare

# %%
field.write(options.out)
picture = options.out / "labels.png"
accessvdb.render_field(picture, snapshot, view_W=(-1.0, -0.4, 0.5))
print("picture:", picture)
