# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Reads points.ply of `accessvdb map`: binary little endian, one record per point. Needs NumPy, not Blender."""

import os

import numpy as np

_NUMPY_TYPES = {
    "char": "<i1", "uchar": "<u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4",
    "float": "<f4", "double": "<f8", "int8": "<i1", "uint8": "<u1", "int16": "<i2", "uint16": "<u2",
    "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8",
}
_MAX_HEADER_BYTES = 1 << 16

#: Columns that every points.ply of AccessVDB has; positions in metres in the world frame, yaw in degrees.
COLUMNS = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "label", "reason", "score", "confidence",
           "stability", "dx", "dy", "dz", "yaw")
#: Columns that files of other orientations than yaw have as well: world from tool.
QUATERNION = ("qw", "qx", "qy", "qz")
#: Columns of several tools: the one that stands for the point, and a bit for each that reaches it.
TOOLS = ("tool", "tools")
#: Columns of tools with margins: metres of room around the tool, and degrees that it can turn; -1 where it does not
#: reach the point.
MARGINS = ("margin_m", "free_arc_deg")
#: How likely the tool reaches the point, 0 to 1; -1 where nothing is said. Files of before, and of the paper's
#: profile, have none.
PROBABILITY = "access_probability"
LABELS = ("unscored", "accessible", "blocked")
REASONS = ("none", "confidence", "normal", "unseen", "unknown", "arm", "tool", "changed",
           "beside_surface")
#: Score of a point of which no direction reached the tool stage.
NO_SCORE = 65535


class FieldError(Exception):
    """What is wrong with a file, and what to do, in one line."""


class Points:
    """The surface points of a field.

    records       structured array, one row per point, the fields of COLUMNS
    origin_W      3 doubles: world position of the local frame of field.vdb, metres
    voxel_size_m  edge of a voxel, metres
    comments      the other comments of the header: name to text
    """

    def __init__(self, records, origin_W, voxel_size_m, comments):
        self.records = records
        self.origin_W = origin_W
        self.voxel_size_m = voxel_size_m
        self.comments = comments

    def __len__(self):
        return len(self.records)

    def positions_W(self):
        """(n, 3) doubles, world frame, metres."""
        return self.columns("x", "y", "z")

    def positions_L(self):
        """(n, 3) doubles, metres, in the local frame of field.vdb."""
        return self.positions_W() - self.origin_W

    def has_orientations(self):
        """Whether the tool was not only turned about the vertical."""
        return all(name in self.records.dtype.names for name in QUATERNION)

    def carried(self):
        """Names of the columns that map --carry and --index brought, such as tree_id."""
        names = self.comments.get("carry", "").split()
        return [name for name in names if name in self.records.dtype.names]

    def best_tool(self, index):
        """Index of the tool that stands for a point; 0 where there is only one."""
        return int(self.records["tool"][index]) if "tool" in self.records.dtype.names else 0

    def columns(self, *names):
        """(n, len(names)) array of the named columns."""
        return np.stack([self.records[name] for name in names], axis=1)


def read_points(path):
    """Points from a points.ply. Raises FieldError for a file that is missing, damaged or from another program."""
    try:
        size = os.path.getsize(path)
        with open(path, "rb") as stream:
            comments, count, dtype, data_at = _read_header(stream, path)
            if size - data_at != count * dtype.itemsize:
                raise FieldError(f"{path}: {size - data_at} bytes of points, but the header says {count} points of "
                                 f"{dtype.itemsize} bytes. Copy or compute it again")
            stream.seek(data_at)
            records = np.fromfile(stream, dtype=dtype, count=count)
    except OSError as error:
        raise FieldError(f"{path}: {error.strerror or error}. "
                         "Choose the --out folder of an accessvdb map run") from None
    if len(records) != count:
        raise FieldError(f"{path}: became shorter while being read. Wait for the run to end")
    points = Points(records, _numbers(comments, "origin_W", 3, path),
                    float(_numbers(comments, "voxel_size_m", 1, path)[0]), comments)
    if not points.voxel_size_m > 0:
        raise FieldError(f"{path}: the voxel size is not positive. Compute the field again")
    _check_values(points, path)
    return points


def _read_header(stream, path):
    foreign = f"{path}: is not a points.ply of AccessVDB"
    text = stream.read(_MAX_HEADER_BYTES)
    end = text.find(b"\nend_header\n")
    if not text.startswith(b"ply\n") or end < 0:
        raise FieldError(f"{foreign} (no PLY header). Choose the --out folder of an accessvdb map run")
    lines = text[:end].decode("utf-8", "replace").split("\n")[1:]
    comments, fields, count = {}, [], None
    for line in lines:
        words = line.split()
        if line.startswith("comment "):
            name, _, value = line[len("comment "):].partition(" ")
            comments[name] = value
        elif words[:1] == ["format"] and words[1:] != ["binary_little_endian", "1.0"]:
            raise FieldError(f"{foreign} (format {' '.join(words[1:])}). Use the file as accessvdb map wrote it")
        elif words[:1] == ["element"] and (len(words) != 3 or words[1] != "vertex" or not words[2].isdigit()):
            raise FieldError(f"{foreign} ({line}). Use the file as accessvdb map wrote it")
        elif words[:1] == ["element"]:
            count = int(words[2])
        elif words[:1] == ["property"]:
            if len(words) != 3 or words[1] not in _NUMPY_TYPES:
                raise FieldError(f"{foreign} ({line}). Use the file as accessvdb map wrote it")
            fields.append((words[2], _NUMPY_TYPES[words[1]]))
    missing = [name for name in COLUMNS if name not in dict(fields)]
    if count is None or missing or len(dict(fields)) != len(fields):
        raise FieldError(f"{foreign} (columns missing: {', '.join(missing) or 'none'}). "
                         "Choose the --out folder of an accessvdb map run")
    return comments, count, np.dtype(fields), end + len(b"\nend_header\n")


def _numbers(comments, name, count, path):
    try:
        values = np.array([float(word) for word in comments[name].split()])
    except (KeyError, ValueError):
        values = np.zeros(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise FieldError(f"{path}: has no comment '{name}' with {count} numbers, so AccessVDB did not write it")
    return values


def _check_values(points, path):
    finite = np.isfinite(points.positions_W()).all(axis=1)
    if not finite.all():
        raise FieldError(f"{path}: point {int(np.argmin(finite))} has no finite position. Compute the field again")
    for name, names in (("label", LABELS), ("reason", REASONS)):
        bad = points.records[name] >= len(names)
        if bad.any():
            at = int(np.argmax(bad))
            raise FieldError(f"{path}: point {at} has {name} {points.records[name][at]}, which this add-on does not "
                             "know. Use the add-on of the version that wrote the field")
