# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Is the tool in Blender where the library had it? Compares the collisions of the placed tool with the map, counted
here, with the counts that the library wrote as `score`; a mirrored tool must not agree."""

import itertools
import json
import unittest

import numpy as np
try:
    import pyopenvdb
except ImportError:
    import openvdb as pyopenvdb  # its name since OpenVDB 12

from accessvdb_import.points_ply import read_points
from field_under_test import PLACED_TOOLS, POINTS, VOLUME, run_tests

_STEP_VOXELS = 0.25  # the tool is filled this densely


def boxes_of(vertices, faces):
    """The tool is made of boxes: for each, a corner and its three edges, found from the mesh alone."""
    part, before = np.arange(len(vertices)), None
    while not np.array_equal(part, before):
        before = part.copy()
        for face in faces:
            part[face] = part[face].min()
    for name in np.unique(part):
        corners = vertices[part == name]
        assert len(corners) == 8
        away = corners[1:] - corners[0]
        yield corners[0], min((np.array(edges) for edges in itertools.combinations(away, 3)), key=lambda edges: np.abs(
            edges @ edges.T - np.diag(np.diag(edges @ edges.T))).sum())


def solid_of(vertices, faces, step):
    """(n, 3) points inside the boxes, in the frame of the vertices."""
    blocks = []
    for corner, edges in boxes_of(vertices, faces):
        counts = np.maximum(1, np.rint(np.linalg.norm(edges, axis=1) / step)).astype(int)
        shares = np.stack(np.meshgrid(*((np.arange(n) + 0.5) / n for n in counts), indexing="ij"), axis=-1)
        blocks.append(corner + shares.reshape(-1, 3) @ edges)
    return np.concatenate(blocks)


def agrees(score, found):
    """The library fills every voxel that the tool touches, this test only those containing a sample: it counts slightly
    fewer, and a voxel or two more where a sample rounds to a different voxel."""
    return 0.75 * score - 3 <= found <= 1.1 * score + 3


class ToolCollisions(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.points = read_points(POINTS)
        cls.distance = pyopenvdb.read(VOLUME, "distance").getConstAccessor()
        cls.weight = pyopenvdb.read(VOLUME, "weight").getConstAccessor()
        cls.solid_below_m = float(cls.points.comments["collision_distance_m"])
        cls.exclusion_m = float(cls.points.comments["self_exclusion_voxels"]) * cls.points.voxel_size_m
        with open(PLACED_TOOLS, encoding="utf-8") as stream:
            cls.placed = json.load(stream)

    def collisions(self, solid_W, tip_W):
        size_m = self.points.voxel_size_m
        offsets = solid_W - tip_W
        far = np.linalg.norm(offsets, axis=1) > self.exclusion_m
        voxel = np.floor((tip_W - self.points.origin_W) / size_m + 0.5)  # the library places the tool at the voxel
        ijk = np.unique(np.floor(voxel + offsets[far] / size_m + 0.5).astype(int), axis=0)
        hits = 0
        for i, j, k in ijk.tolist():
            hits += self.weight.getValue((i, j, k)) > 0 and self.distance.getValue((i, j, k)) < self.solid_below_m
        return hits

    def counted(self, mirrored=False):
        """For each placed tool: label, the library's score, and the collisions counted here; mirrored about the
        vertical plane through the body if requested."""
        for tool in self.placed:
            record = self.points.records[tool["point"]]
            tip_W = self.points.positions_W()[tool["point"]]
            solid_W = solid_of(np.array(tool["vertices_W"]), tool["faces"], _STEP_VOXELS * self.points.voxel_size_m)
            if mirrored:
                side = np.array([-record["dy"], record["dx"], 0.0])
                solid_W = solid_W - 2 * ((solid_W - tip_W) @ side)[:, None] * side
            yield record["label"], int(record["score"]), self.collisions(solid_W, tip_W)

    def test_the_boxes_are_filled(self):
        tool = self.placed[0]
        volume_m3 = sum(abs(np.linalg.det(edges)) for _, edges in boxes_of(np.array(tool["vertices_W"]), tool["faces"]))
        self.assertAlmostEqual(volume_m3, (8 * 8 * 120 + 40 * 8 * 20 + 8 * 20 * 20) * 1e-9, delta=1e-9)

    def test_where_the_library_counted_collisions_there_are_as_many(self):
        rows = [row for row in self.counted() if row[0] == 2]
        self.assertGreaterEqual(len(rows), 25)
        self.assertGreater(np.median([score for _, score, _ in rows]), 50)
        self.assertEqual([row for row in rows if not agrees(*row[1:])], [])

    def test_where_the_tool_fits_it_does(self):
        limit = int(self.points.comments["collision_limit"])
        rows = [row for row in self.counted() if row[0] == 1]
        self.assertGreaterEqual(len(rows), 25)
        self.assertLessEqual(max(score for _, score, _ in rows), limit)
        self.assertEqual([row for row in rows if not agrees(*row[1:])], [])

    def test_a_mirrored_tool_would_be_noticed(self):
        rows = [row for row in self.counted(mirrored=True) if row[0] == 2]
        self.assertGreater(np.mean([not agrees(score, found) for _, score, found in rows]), 0.8)


run_tests()
