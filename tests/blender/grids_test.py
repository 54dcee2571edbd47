# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""field.vdb in Blender, without the add-on: every grid is listed with its type, and is where OpenVDB says."""

import unittest

import bpy
import numpy as np

from accessvdb_import.points_ply import read_points
from field_under_test import GRIDS, POINTS, VOLUME, boxes, run_tests


class GridsInBlender(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # What File > Import > OpenVDB does; factory settings do not open such a file.
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.object.volume_import(filepath=VOLUME)
        cls.thing = bpy.context.active_object
        cls.voxel_size_m = read_points(POINTS).voxel_size_m
        cls.thing.data.grids.load()

    def test_every_grid_is_listed_with_its_type(self):
        grids = self.thing.data.grids
        self.assertEqual(grids.error_message, "")
        expected = {name: kind for name, (kind, _) in GRIDS.items()}
        self.assertEqual({grid.name: grid.data_type for grid in grids}, expected)

    def test_every_grid_loads_and_has_the_voxel_size(self):
        for grid in self.thing.data.grids:
            self.assertTrue(grid.load(), grid.name)
            np.testing.assert_allclose(np.array(grid.matrix_object), np.diag([self.voxel_size_m] * 3 + [1]), rtol=1e-6)

    def test_it_is_neither_turned_nor_moved_on_import(self):
        np.testing.assert_array_equal(np.array(self.thing.matrix_world), np.eye(4))

    def test_the_box_is_the_maps_within_half_a_voxel(self):
        # Blender 3.4 takes the box of the leaves (8 voxels a side) around the active voxels, later ones the box of the
        # active voxels; all take the box over all grids.
        evaluated = self.thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
        corners = np.array([tuple(corner) for corner in evaluated.bound_box])
        found = np.stack([corners.min(axis=0), corners.max(axis=0)]) / self.voxel_size_m
        matches = []
        for kind in ("active", "leaves"):
            of_grids = np.array([box[kind] for box in boxes().values()], dtype=float)
            expected = np.stack([of_grids[:, 0].min(axis=0), of_grids[:, 1].max(axis=0)])
            self.assertGreater(np.ptp(expected, axis=0).min(), 10)
            matches.append(np.abs(found - expected).max())
        self.assertLessEqual(min(matches), 0.5 + 1e-3, f"box in voxels {found.tolist()}, off by {matches}")


run_tests()
