# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Scans of a corner: a wall, a floor, and a slot in the wall too narrow for a tool. Exact ranges, no noise."""

import numpy as np

import accessvdb

VOXEL_M = 0.05


def pose(x=0.0, y=0.0, z=0.0):
    """A sensor that looks along the world's axes."""
    T_W_S = np.eye(4)
    T_W_S[:3, 3] = x, y, z
    return T_W_S


def scan(T_W_S, rays=6000, seed=1):
    """(N, 3) float64 returns in the sensor frame: of the wall x = 3, set back to x = 3.3 where |y| < 0.15, and of the
    floor z = -1."""
    random = np.random.default_rng(seed)
    yaw, pitch = random.uniform(-0.7, 0.7, rays), random.uniform(-0.6, 0.5, rays)
    ray = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1)
    q = T_W_S[:3, 3]
    y_at_wall = q[1] + ray[:, 1] * (3 - q[0]) / ray[:, 0]
    to_wall = (np.where(np.abs(y_at_wall) < 0.15, 3.3, 3.0) - q[0]) / ray[:, 0]
    to_floor = np.where(ray[:, 2] < 0, (-1 - q[2]) / np.minimum(ray[:, 2], -1e-9), np.inf)
    return ray * np.minimum(to_wall, to_floor)[:, None]


def field(frames=4, tool="builtin:pruner", **params):
    """A field of a few scans, updated."""
    params.setdefault("tsdf", {"voxel_size_m": VOXEL_M})
    made = accessvdb.AccessibilityField(accessvdb.ToolGeometry.builtin(tool), params)
    for n in range(frames):
        T_W_S = pose(y=0.2 * n)
        made.integrate_scan(scan(T_W_S, seed=n), T_W_S)
    made.update()
    return made
