# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Simulates scans of a torus, maps them with the built program, and notes what OpenVDB says about the boxes."""

import json
import os
import shutil
import subprocess

try:
    import pyopenvdb
except ImportError:
    import openvdb as pyopenvdb  # its name since OpenVDB 12

import hook
from field_under_test import APPROACHES, EDGE_OF_TILES_M, FIELD, FIELD_IN_TILES, FIELD_Y_UP, TOOL, VOLUME, WORK

PROGRAM, LAB_PROGRAM = os.environ["PROGRAM"], os.environ["LAB_PROGRAM"]


def text(vector):
    return ",".join(str(value) for value in vector)


def main():
    scans = os.path.join(WORK, "scans")
    state = os.path.join(WORK, "state")
    for folder in (scans, state, APPROACHES, FIELD, FIELD_Y_UP, FIELD_IN_TILES):
        shutil.rmtree(folder, ignore_errors=True)
    hook.write_stl(TOOL)
    subprocess.run([LAB_PROGRAM, "simulate", "--scene", "torus", "--frames", "16", "--seed", "1", "--out", scans],
                   check=True)
    tool = ["--tool", TOOL, "--tool-unit", hook.UNIT, "--tool-tip", text(hook.TIP), "--tool-axis", text(hook.AXIS), "--tool-up",
            text(hook.UP), "--device", "cpu"]
    for folder, options in ((FIELD, ["--checkpoint", state]), (FIELD_Y_UP, ["--up-axis", "y", "--half", "--surface"]),
                            (FIELD_IN_TILES, ["--tiles", str(EDGE_OF_TILES_M)])):
        subprocess.run([PROGRAM, "map", "--scans", os.path.join(scans, "scans"), "--poses",
                        os.path.join(scans, "poses.txt"), *tool, "--voxel", "0.004", "--out", folder] + options, check=True)
    subprocess.run([PROGRAM, "approaches", "--map", state, *tool, "--allow-unknown", "--spacing", "0.05", "--stand-off", "0.1",
                    "--most", "8", "--out", APPROACHES], check=True)
    boxes = {}
    for grid in pyopenvdb.readAllGridMetadata(VOLUME):
        grid = pyopenvdb.read(VOLUME, grid.name)
        boxes[grid.name] = {"active": grid.evalActiveVoxelBoundingBox(), "leaves": grid.evalLeafBoundingBox()}
    with open(os.path.join(WORK, "boxes.json"), "w", encoding="utf-8") as stream:
        json.dump(boxes, stream)


main()
