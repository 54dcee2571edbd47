# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The tool's frame and its placement at a point, as in the C++ library. Needs NumPy, not Blender.

Tool frame T: metres, the tip at the origin, +x from the tip along the body (the way the tool withdraws), +z up. At a
surface point, the tip is at the point and the body along the point's best direction: T_W_T = [R_z(yaw) | p_W], or
[R(quaternion) | p_W] for a field whose tool was not only turned about the vertical.
"""

from dataclasses import dataclass

import numpy as np

from .points_ply import QUATERNION, REASONS, FieldError

METRES_PER = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
_MIN_SIZE_M, _MAX_SIZE_M = 0.001, 20.0  # what the library accepts as a tool


@dataclass
class ToolPose:
    """How a mesh's own frame maps to the tool frame; tip, axis and up in the mesh's own units and axes."""

    unit: str = None  # m, cm, mm or in
    tip: tuple = (0.0, 0.0, 0.0)
    axis: tuple = (1.0, 0.0, 0.0)  # from the tip along the body
    up: tuple = (0.0, 0.0, 1.0)  # becomes +z as far as it is perpendicular to the axis


def rotation_T_M(pose):
    """(3, 3): rows are the tool frame's axes in the mesh's axes. Raises FieldError for a pose that has no frame."""
    axis, up, tip = (np.array(v, dtype=float) for v in (pose.axis, pose.up, pose.tip))
    if not all(np.isfinite(v).all() for v in (axis, up, tip)):
        raise FieldError("The tool's tip, axis or up is not finite. Use three numbers each")
    if not np.linalg.norm(axis) > 0 or not np.linalg.norm(up) > 0:
        raise FieldError("The tool's axis or up is zero. Use directions such as 1, 0, 0 and 0, 0, 1")
    x = axis / np.linalg.norm(axis)
    up = up / np.linalg.norm(up)
    z = up - up.dot(x) * x
    if not np.linalg.norm(z) > 1e-6:
        raise FieldError("The tool's axis and up are parallel. Choose an up that is not along the axis")
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def vertices_in_tool_frame(vertices_M, pose):
    """(n, 3) vertices of a mesh in its own frame and units, in the tool frame in metres. Raises FieldError."""
    if pose.unit not in METRES_PER:
        raise FieldError("This mesh format has no length unit. Specify it: m, cm, mm or in")
    vertices_M = np.asarray(vertices_M, dtype=float)
    if len(vertices_M) == 0 or not np.isfinite(vertices_M).all():
        raise FieldError("The tool mesh has no vertices, or one that is not finite. Export it again")
    size_m = float(np.ptp(vertices_M, axis=0).max() * METRES_PER[pose.unit])
    if not _MIN_SIZE_M <= size_m <= _MAX_SIZE_M:
        raise FieldError(f"The tool would be {size_m:.4g} m large; {_MIN_SIZE_M} to {_MAX_SIZE_M:g} m is plausible. "
                         "Check its unit: m, cm, mm or in")
    return METRES_PER[pose.unit] * (vertices_M - np.array(pose.tip, dtype=float)) @ rotation_T_M(pose).T


def placement_L(points, index):
    """(4, 4) matrix from the tool frame to the field's local frame for the best direction of a point.

    Raises FieldError if the point does not exist or no direction was ever tried there."""
    if not 0 <= index < len(points):
        raise FieldError(f"There is no point {index}: the field has {len(points)}, counted from 0")
    record = points.records[index]
    direction = np.array([record["dx"], record["dy"], record["dz"]], dtype=float)
    if not np.isfinite(direction).all() or not np.linalg.norm(direction) > 0.5:
        raise FieldError(f"Point {index} has no best direction (reason: {REASONS[record['reason']]}). Choose another")
    matrix = np.eye(4)
    if points.has_orientations():
        quaternion = np.array([record[name] for name in QUATERNION], dtype=float)
        try:
            matrix[:3, :3] = rotation_of(quaternion)
        except FieldError as error:
            raise FieldError(f"Point {index}: {error}. Compute the field again") from None
    else:
        cos, sin = direction[:2] / np.linalg.norm(direction[:2])
        matrix[:3, :3] = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
    matrix[:3, 3] = np.array([record["x"], record["y"], record["z"]]) - points.origin_W
    return matrix


def rotation_of(quaternion):
    """(3, 3) of a quaternion, w first. Raises FieldError if it is no unit quaternion, without saying where it is."""
    length = np.linalg.norm(quaternion)
    if not np.isfinite(quaternion).all() or not abs(length - 1) < 1e-3:
        raise FieldError("an orientation is no unit quaternion")
    w, x, y, z = quaternion / length
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
