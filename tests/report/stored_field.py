# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes points.ply and report.json by NumPy alone, as docs/file_formats.md describes them."""

import json
import pathlib

import numpy as np

RECORD = np.dtype([("position", "<f8", 3), ("normal", "<f4", 3), ("colour", "u1", 3), ("label", "u1"), ("reason", "u1"),
                   ("score", "<u2"), ("confidence", "<f4"), ("stability", "<f4"), ("direction", "<f4", 3),
                   ("yaw", "<f4")])
WITH_PROBABILITY = np.dtype(RECORD.descr + [("access_probability", "<f4")])
LABELS = ["unscored", "accessible", "blocked"]
REASONS = ["none", "confidence", "normal", "unseen", "unknown", "arm", "tool"]
PROPERTIES = ("double x,double y,double z,float nx,float ny,float nz,uchar red,uchar green,uchar blue,uchar label,"
              "uchar reason,ushort score,float confidence,float stability,float dx,float dy,float dz,float yaw").split(",")


def read_points(folder):
    """The records of points.ply."""
    data = (pathlib.Path(folder) / "points.ply").read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    return np.frombuffer(data, WITH_PROBABILITY if b"\nproperty float access_probability\n" in data[:end] else RECORD,
                         offset=end)


def read_report(folder):
    return json.loads((pathlib.Path(folder) / "report.json").read_text())


def random_points(count, seed=1, size_m=4.0):
    """Points with every label, reason and some directions."""
    random = np.random.default_rng(seed)
    points = np.zeros(count, RECORD)
    points["position"] = random.uniform(0, size_m, (count, 3))
    normals = random.normal(size=(count, 3))
    points["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    points["reason"] = random.integers(0, len(REASONS), count)
    points["label"] = np.where(points["reason"] == 0, 1, np.where(points["reason"] == 1, 0, 2))
    yaw = random.integers(0, 180, count) * 2.0
    points["yaw"] = yaw
    points["direction"][:, 0] = np.cos(np.radians(yaw))
    points["direction"][:, 1] = np.sin(np.radians(yaw))
    # As rows have them: what is accessible collides with fewer voxels than the limit, what the tool blocks with more.
    points["score"] = np.where(points["label"] == 1, random.integers(0, 4, count), random.integers(4, 50, count))
    points["confidence"] = random.uniform(0, 1, count)
    points["stability"] = 1
    return points


def write_field(folder, points, voxel_size_m=0.05, comments=(), report=None, carried=None, tools=None,
                probability=None):
    """A folder as `map` leaves it. @param report  changes to report.json; None = the counts of the points alone
    @param carried  {name: what the returns of each point carried}
    @param tools    (names, index of the tool that stands for each point, mask of those that reach it)
    @param probability  access_probability of each point"""
    carried = carried or {}
    of_tools = [("tool", "u1"), ("tools", "<u4")] if tools else []
    of_probability = [] if probability is None else [("access_probability", "<f4")]
    rows = np.empty(len(points), np.dtype(RECORD.descr + of_tools + of_probability + [(name, "<i4") for name in carried]))
    if probability is not None:
        rows["access_probability"] = probability
        comments = [*comments, "access_probability 1"]
    if tools:
        rows["tool"], rows["tools"] = tools[1:]
        comments = [*comments, *[f"tool_{name}_collision_limit 4" for name in tools[0]], f"tools {','.join(tools[0])}"]
    for name in RECORD.names:
        rows[name] = points[name]
    for name, values in carried.items():
        rows[name] = values
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["ply", "format binary_little_endian 1.0", "comment AccessVDB 0.1.0", "comment origin_W 0 0 0",
             f"comment voxel_size_m {voxel_size_m}", "comment num_directions 180", "comment collision_limit 4",
             *[f"comment {each}" for each in comments], f"element vertex {len(points)}",
             *[f"property {each}" for each in PROPERTIES], *(["property uchar tool", "property uint tools"] if tools else []),
             *[f"property float {name}" for name, _ in of_probability],
             *[f"property int {name}" for name in carried], "end_header\n"]
    with open(folder / "points.ply", "wb") as file:
        file.write("\n".join(lines).encode())
        rows.tofile(file)
    counts = {label: int((points["label"] == n).sum()) for n, label in enumerate(LABELS)}
    reasons = {reason: int((points["reason"] == n).sum()) for n, reason in enumerate(REASONS) if n > 0}
    content = {"schema": 1, "version": "0.1.0", "exit_code": 0, "device": "cpu", "parameters": {}, "inputs": [],
               "counts": {"scans": 1, "points_in": len(points), "points_used": len(points), "dropped": {},
                          "surface_points": len(points), **counts, "reasons": reasons},
               "warnings": [], "notices": [], **(report or {})}
    (folder / "report.json").write_text(json.dumps(content))
    return folder


def turned(quaternion, vectors):
    """Vectors, (n, 3), turned by a unit quaternion, w first: by the product q v q*, not by a matrix."""
    w, u = quaternion[0], np.array(quaternion[1:])
    across = 2 * np.cross(u, vectors)
    return vectors + w * across + np.cross(u, across)


def target_at(point, position, quaternions, stand_off_m=0.4, **changes):
    """A target of approaches.json, with an approach for each quaternion."""
    position = np.array(position)

    def pose(quaternion, back_m):
        place = position + back_m * turned(quaternion, np.array([[1.0, 0, 0]]))[0]
        return {"position": place.tolist(), "orientation_wxyz": list(map(float, quaternion))}

    approaches = [{"pre_contact": pose(q, stand_off_m), "contact": pose(q, 0), "retreat": pose(q, 2 * stand_off_m),
                   "direction": 0, "roll": 0, "collisions": 1, "free_arc_deg": 40.0, "seen_free_m": 0.8}
                  for q in quaternions]
    return {"point": int(point), "position": position.tolist(), "normal": [0, 0, 1], "tool": "tool", "margin_m": None,
            "confidence": 0.75, "distance_m": 0.0, "covers_points": 12, "value": 0, "why": f"of point {point}",
            "approaches": approaches, **changes}


def view_at(position, quaternion, **changes):
    """A view of views.json."""
    return {"pose": {"position": list(map(float, position)), "orientation_wxyz": list(map(float, quaternion))},
            "resolves": 1234.5, "of_confidence": 1000.5, "of_unseen": 200.0, "of_unknown": 34.0, "travel_m": 2.5,
            "way_is_free": True, "why": "resolves about 1234 points", **changes}


def write_views(folder, views, points=None):
    """views.json as `accessvdb views` leaves it. @param points  of the map whose unresolved points are counted"""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    unresolved = {reason: 0 if points is None else int((points["reason"] == REASONS.index(reason)).sum())
                  for reason in ("confidence", "unseen", "unknown")}
    (folder / "views.json").write_text(
        json.dumps({"unresolved_points": unresolved, "poses_compared": 20, "views": views}, indent=2))
    return folder


def write_approaches(folder, targets):
    """approaches.json as `accessvdb approaches` leaves it."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    content = {"accessible_points": 100, "covered_points": 60, "tried_without_way": 0, "targets": targets}
    (folder / "approaches.json").write_text(json.dumps(content, indent=2))
    return folder
