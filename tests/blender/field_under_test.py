# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Where the tests' field is, and how a test script ends. Needs neither Blender nor OpenVDB."""

import json
import os
import sys
import unittest

WORK = os.environ["WORK"]
SOURCE = os.environ["SOURCE"]
FIELD = os.path.join(WORK, "field")
VOLUME = os.path.join(FIELD, "field.vdb")
POINTS = os.path.join(FIELD, "points.ply")
#: The same map, written for a program in which y is up, with 16-bit floats and a level set.
FIELD_Y_UP = os.path.join(WORK, "field_y_up")
#: The same map in tiles of this edge.
FIELD_IN_TILES, EDGE_OF_TILES_M = os.path.join(WORK, "field_in_tiles"), 0.512
#: approaches.json of the field.
APPROACHES = os.path.join(WORK, "approaches")
TOOL = os.path.join(WORK, "hook.stl")
PLACED_TOOLS = os.path.join(WORK, "placed_tools.json")

#: Contents of field.vdb: name to Blender's type name and OpenVDB's grid class.
GRIDS = {
    "density": ("FLOAT", "fog volume"),
    "accessible": ("FLOAT", "fog volume"),
    "blocked": ("FLOAT", "fog volume"),
    "confidence": ("FLOAT", "unknown"),
    "score": ("FLOAT", "unknown"),
    "best_direction": ("VECTOR_FLOAT", "unknown"),
    "distance": ("FLOAT", "unknown"),  # clamped: it has no zero crossing, so it is not a level set
    "weight": ("FLOAT", "unknown"),
    "cleared": ("BOOLEAN", "unknown"),
}


def boxes():
    """For each grid, boxes of voxel indices {"active": [min, max], "leaves": [min, max]}, read by OpenVDB itself."""
    with open(os.path.join(WORK, "boxes.json"), encoding="utf-8") as stream:
        return json.load(stream)


def run_tests():
    """Runs the tests of the calling script; exit code 1 if one fails or none ran."""
    result = unittest.main(module="__main__", argv=["tests"], exit=False, verbosity=2).result
    if not result.wasSuccessful() or result.testsRun == 0:
        sys.exit(1)
