# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""field.vdb read by OpenVDB's own Python module and by vdb_print: every grid, its class, frame and values."""

import subprocess
import unittest

import numpy as np
try:
    import pyopenvdb
except ImportError:
    import openvdb as pyopenvdb  # its name since OpenVDB 12

from accessvdb_import.points_ply import NO_SCORE, read_points
from field_under_test import GRIDS, POINTS, VOLUME, run_tests

_TYPES = {"FLOAT": pyopenvdb.FloatGrid, "BOOLEAN": pyopenvdb.BoolGrid, "VECTOR_FLOAT": pyopenvdb.Vec3SGrid}


class VdbReading(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.grids, cls.metadata = pyopenvdb.readAll(VOLUME)
        cls.points = read_points(POINTS)
        cls.voxels = np.floor(cls.points.positions_L() / cls.points.voxel_size_m + 0.5).astype(int)

    def grid(self, name):
        return next(grid for grid in self.grids if grid.name == name)

    def test_every_grid_is_there_once_with_its_type_and_class(self):
        found = {grid.name: (type(grid), grid.gridClass) for grid in self.grids}
        self.assertEqual(len(found), len(self.grids))
        self.assertEqual(found, {name: (_TYPES[kind], grid_class) for name, (kind, grid_class) in GRIDS.items()})

    def test_voxel_ijk_lies_at_ijk_times_the_voxel_size(self):
        size_m = self.points.voxel_size_m
        for grid in self.grids:
            for ijk in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (-3, 5, 7)):
                np.testing.assert_allclose(grid.transform.indexToWorld(ijk), size_m * np.array(ijk), rtol=1e-12, atol=0,
                                           err_msg=grid.name)

    def test_metadata_say_origin_version_tool_and_parameters(self):
        for name, value in zip("xyz", self.points.origin_W):
            self.assertEqual(self.metadata[f"origin_W_{name}"], value)
            for grid in self.grids:
                self.assertEqual(grid[f"origin_W_{name}"], value)
        self.assertGreater(np.abs(self.points.origin_W).max(), 0)  # else the lines above prove little
        self.assertEqual(self.metadata["voxel_size_m"], self.points.voxel_size_m)
        for name in ("accessvdb_version", "tool", "tool_sha256", "num_directions", "truncation_distance_m"):
            self.assertEqual(self.metadata[name], self.points.comments[name])
        for grid in self.grids:
            self.assertTrue(grid["description"], grid.name)
        self.assertEqual((self.metadata["length_unit"], self.metadata["up_axis"]), ("m", "z"))
        units = {grid.name: grid["value_unit"] for grid in self.grids}
        self.assertEqual(units, {**dict.fromkeys(GRIDS, "1"), "distance": "m", "score": "collisions",
                                 "weight": "observations"})

    def test_the_fogs_are_1_in_the_voxels_of_their_points_and_nowhere_else(self):
        labels = self.points.records["label"]
        for name, kept in (("density", labels >= 0), ("accessible", labels == 1), ("blocked", labels == 2)):
            self.assertGreater(kept.sum(), 100, name)
            active = {item.min: item.value for item in self.grid(name).citerOnValues() if item.min == item.max}
            self.assertEqual(self.grid(name).activeVoxelCount(), len(active), name)
            self.assertEqual(set(active), {tuple(int(i) for i in ijk) for ijk in self.voxels[kept]}, name)
            self.assertEqual(set(active.values()), {1.0}, name)
            self.assertEqual(self.grid(name).background, 0.0, name)

    def test_the_attributes_are_those_of_the_points(self):
        records = self.points.records
        score = np.where(records["score"] == NO_SCORE, -1, records["score"].astype(int))
        readers = {name: self.grid(name).getConstAccessor()
                   for name in ("confidence", "score", "best_direction", "weight")}
        for row, ijk in enumerate(self.voxels):
            ijk = tuple(int(i) for i in ijk)
            self.assertEqual(readers["confidence"].getValue(ijk), records["confidence"][row])
            self.assertEqual(readers["score"].getValue(ijk), score[row])
            self.assertEqual(readers["best_direction"].getValue(ijk), tuple(records[row][["dx", "dy", "dz"]]))
            self.assertGreater(readers["weight"].getValue(ijk), 0)

    def test_distance_is_never_negative_and_at_most_the_truncation(self):
        low, high = self.grid("distance").evalMinMax()
        self.assertGreaterEqual(low, 0)
        self.assertLessEqual(high, np.float32(self.metadata["truncation_distance_m"]))

    def test_vdb_print_lists_every_grid(self):
        text = subprocess.run(["vdb_print", "-l", VOLUME], check=True, capture_output=True, text=True).stdout
        for name, (_, grid_class) in GRIDS.items():
            part = text.split(f"Name: {name}\n", 1)[1].split("\nName: ", 1)[0]
            self.assertIn(f"class: {grid_class}\n", part)
            self.assertIn(f"voxel size: {self.points.voxel_size_m:g}\n", part)


run_tests()
