# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Reads a folder of `map` with only OpenVDB's Python module and NumPy, and compares field.vdb with points.ply.

read_field.py FOLDER UP_AXIS(z|y) PRECISION(float|half) NUMBER_OF_GRIDS; exits 1 with one line for the first difference.
"""
import json
import math
import sys

import numpy
try:
    import pyopenvdb
except ImportError:
    import openvdb as pyopenvdb  # its name since OpenVDB 12

FOGS = {"density", "accessible", "blocked"}
COUNTS = {"score", "weight"}  # never halves
UNITS = {
    "density": "1", "accessible": "1", "blocked": "1", "confidence": "1", "score": "collisions",
    "best_direction": "1", "distance": "m", "weight": "observations", "cleared": "1", "surface": "m",
}
# Command line flags, only in report.json.
FLAGS = {
    "scans", "poses", "pose_format", "tool", "tool_unit", "tool_tip", "tool_axis", "tool_up", "profile", "every",
    "update_every", "half", "compression", "up_axis", "surface", "sequence", "mirror_distance",
    "points_format",
}
PLY_TYPES = {"double": "<f8", "float": "<f4", "uchar": "u1", "ushort": "<u2"}


def check(condition, text):
    if not condition:
        sys.exit("read_field.py: " + text)


def read_ply(path):
    """Records of the points as a structured array, and the header's comments as a dictionary."""
    with open(path, "rb") as file:
        data = file.read()
    header, body = data.split(b"end_header\n", 1)
    comments, fields, count = {}, [], 0
    for line in header.decode().splitlines():
        words = line.split()
        if words[0] == "comment":
            comments[words[1]] = " ".join(words[2:])
        elif words[:2] == ["element", "vertex"]:
            count = int(words[2])
        elif words[0] == "property":
            fields.append((words[2], PLY_TYPES[words[1]]))
    points = numpy.frombuffer(body, dtype=numpy.dtype(fields))
    check(len(points) == count, "points.ply promises %d points and holds %d" % (count, len(points)))
    return points, comments


def plain(value):
    """A number as a number, whether stored as one or as text; anything else as text."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        return float(value)
    except ValueError:
        return str(value)


def check_file_metadata(metadata, report, comments, up):
    check(metadata["up_axis"] == up, "up_axis is " + str(metadata["up_axis"]))
    check(metadata["length_unit"] == "m", "length_unit is " + str(metadata["length_unit"]))
    check(metadata["accessvdb_version"] == report["version"], "another version than report.json")
    check(metadata["tool"] == report["parameters"]["tool"], "another tool than report.json")
    check(len(metadata["tool_sha256"]) == 64, "tool_sha256 is no hash")
    check(metadata["tool_sha256"] == comments["tool_sha256"], "another tool hash than points.ply")
    origin = [metadata["origin_W_" + axis] for axis in "xyz"]
    check(origin == [float(word) for word in comments["origin_W"].split()], "another origin than points.ply")
    check(metadata["voxel_size_m"] == float(comments["voxel_size_m"]), "another voxel size than points.ply")
    # report.json lists the flags and then every effective parameter; these are in the file as well.
    parameters = {key: value for key, value in report["parameters"].items() if key not in FLAGS}
    check(len(parameters) > 20, "report.json names only %d parameters" % len(parameters))
    for key, value in parameters.items():
        check(key in metadata, "parameter %s is missing" % key)
        check(plain(metadata[key]) == plain(value), "parameter %s is %s, not %s" % (key, metadata[key], value))


def check_grid(grid, metadata, up, precision):
    name = grid.name
    half = precision == "half" and name not in COUNTS and name != "cleared"
    check(grid.saveFloatAsHalf == half, "%s: saveFloatAsHalf is %s" % (name, grid.saveFloatAsHalf))
    wanted = "fog volume" if name in FOGS else "level set" if name == "surface" else "unknown"
    check(grid.gridClass == wanted, "%s is of class %s" % (name, grid.gridClass))
    wanted = "vec3s" if name == "best_direction" else "bool" if name == "cleared" else "float"
    check(grid.valueTypeName == wanted, "%s has values of type %s" % (name, grid.valueTypeName))
    check(grid["value_unit"] == UNITS[name], "%s has unit %s" % (name, grid["value_unit"]))
    check(len(grid["description"]) > 10, "%s has no description" % name)
    for key in ("up_axis", "length_unit", "accessvdb_version", "origin_W_x", "origin_W_y", "origin_W_z"):
        check(grid[key] == metadata[key], "%s: %s differs from the file's" % (name, key))
    check(grid.creator.startswith("AccessVDB "), "%s was made by %s" % (name, grid.creator))
    v = metadata["voxel_size_m"]
    x, y, z = grid.transform.indexToWorld((3, 50, -7))
    exact = (3 * v, 50 * v, -7 * v) if up == "z" else (3 * v, -7 * v, -50 * v)
    check(max(abs(a - b) for a, b in zip((x, y, z), exact)) < 1e-12, "%s: voxel (3, 50, -7) lies at %s" % (name, (x, y, z)))


def check_values(grids, metadata, points, up, precision):
    v = metadata["voxel_size_m"]
    origin = numpy.array([metadata["origin_W_" + axis] for axis in "xyz"])
    local = numpy.stack([points["x"], points["y"], points["z"]], axis=1) - origin
    voxels = numpy.floor(local / v + 0.5).astype(int)
    labels, reached = points["label"], {"accessible": 1, "blocked": 2}
    voxel_count = len(numpy.unique(voxels, axis=0))
    check(grids["density"].activeVoxelCount() == voxel_count, "density has other voxels than points.ply")
    accessors = {name: grid.getConstAccessor() for name, grid in grids.items()}
    error = 2.0**-11 if precision == "half" else 0.0
    for n, voxel in enumerate(voxels):
        ijk = tuple(int(i) for i in voxel)
        check(accessors["density"].isValueOn(ijk), "density is off at point %d" % n)
        for name, label in reached.items():
            check(accessors[name].isValueOn(ijk) == (labels[n] == label), "%s is wrong at point %d" % (name, n))
        score = -1.0 if points["score"][n] == 65535 else float(points["score"][n])
        check(accessors["score"].getValue(ijk) == score, "score is wrong at point %d" % n)
        confidence = accessors["confidence"].getValue(ijk)
        check(abs(confidence - points["confidence"][n]) <= error, "confidence is wrong at point %d" % n)
        d = [float(points[key][n]) for key in ("dx", "dy", "dz")]
        d = d if up == "z" else [d[0], d[2], -d[1]]
        got = accessors["best_direction"].getValue(ijk)
        check(max(abs(a - b) for a, b in zip(got, d)) <= error, "best_direction is wrong at point %d" % n)
    for name, label in reached.items():
        count = int(numpy.count_nonzero(labels == label))
        check(grids[name].activeVoxelCount() == count, "%s has other voxels than points.ply" % name)
        check(count > 0, "no point is %s: nothing was tested" % name)
    if "surface" in grids:
        surface = accessors["surface"]
        normals = numpy.stack([points["nx"], points["ny"], points["nz"]], axis=1)
        tested = 0
        for voxel, normal in zip(voxels, normals):
            if not normal.any():
                continue
            # The surface passes through the voxel of each point that has a normal.
            value = surface.getValue(tuple(int(i) for i in voxel))
            check(abs(value) <= v * math.sqrt(3), "surface is %g m away from a point" % value)
            tested += 1
        check(tested > 100, "hardly a point has a normal")


def main():
    folder, up, precision, number = sys.argv[1:]
    grids, metadata = pyopenvdb.readAll(folder + "/field.vdb")
    with open(folder + "/report.json") as file:
        report = json.load(file)
    points, comments = read_ply(folder + "/points.ply")
    check(len(grids) == int(number), "field.vdb holds %d grids, not %s" % (len(grids), number))
    check({grid.name for grid in grids} == set(list(UNITS)[: int(number)]), "field.vdb holds other grids")
    check_file_metadata(metadata, report, comments, up)
    for grid in grids:
        check_grid(grid, metadata, up, precision)
    check_values({grid.name: grid for grid in grids}, metadata, points, up, precision)
    counts = report["counts"]
    for n, label in enumerate(("unscored", "accessible", "blocked")):
        check(counts[label] == int(numpy.count_nonzero(points["label"] == n)), "report.json counts other points")
    print("%s: %d grids, %d points" % (folder, len(grids), len(points)))


main()
