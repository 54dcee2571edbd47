# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Batch queries: the answers of the snapshot, of point_at and of the scene itself."""

import unittest

import numpy as np

import accessvdb
import walls


class Query(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.field = walls.field()
        cls.snapshot = cls.field.snapshot()

    def test_at_the_surface_points(self):
        s = self.snapshot
        answers = self.field.query(s.position_W)
        self.assertEqual(len(answers), len(s))
        np.testing.assert_array_equal(answers.point_id, s.id)
        for name in ("label", "reason", "score", "direction", "direction_W"):
            np.testing.assert_array_equal(getattr(answers, name), getattr(s, name), name)
        self.assertFalse(answers.unknown.any())
        self.assertTrue((answers.weight > 0).all())
        np.testing.assert_allclose(answers.point_distance_m, 0, atol=1e-5)

    def test_far_away_bad_and_in_between(self):
        positions = np.array([[50, 50, 50], [np.nan, 0, 0], [np.inf, 0, 0], [1e300, 0, 0], [2.85, -0.5, 0.1]])
        answers = self.field.query(positions)
        np.testing.assert_array_equal(answers.unknown, [True, True, True, True, False])
        self.assertTrue((answers.point_id[:4] == accessvdb.NO_POINT).all())
        self.assertTrue((answers.label[:4] == accessvdb.PointLabel.UNSCORED).all())
        self.assertTrue(np.isnan(answers.distance_m[:4]).all())
        self.assertTrue(answers.cleared[4] or answers.weight[4] > 0)
        self.assertEqual(len(self.field.query(np.empty((0, 3)))), 0)

    def test_columns_are_views_that_nobody_writes_to(self):
        answers = self.field.query(self.snapshot.position_W[:5])
        for name in answers.records.dtype.names:
            column = getattr(answers, name)
            self.assertIs(column.base, answers)
            self.assertFalse(column.flags.writeable)
            np.testing.assert_array_equal(column, answers.records[name])
        label = answers.label
        expected = label.copy()
        del answers
        np.testing.assert_array_equal(label, expected)

    def test_the_tool_fits_where_it_touches_and_not_in_the_wall(self):
        s = self.snapshot
        accessible = np.flatnonzero(s.label == accessvdb.PointLabel.ACCESSIBLE)[:200]
        T_WT = np.repeat(np.eye(4)[None], len(accessible), axis=0)
        T_WT[:, :3, 3] = s.position_W[accessible]
        T_WT[:, :3, 0] = s.direction_W[accessible]  # yaw: the body lies level, and z is up
        T_WT[:, :3, 1] = np.cross([0, 0, 1], s.direction_W[accessible])
        T_WT[:, :3, :3] = np.linalg.svd(T_WT[:, :3, :3])[0] @ np.linalg.svd(T_WT[:, :3, :3])[2]
        contact = self.field.fits(T_WT, contact=True)
        self.assertTrue(contact.valid.all())
        self.assertFalse(contact.collision.any())
        np.testing.assert_array_equal(contact.collisions, s.score[accessible])
        into = T_WT.copy()
        into[:, :3, 3] -= 0.4 * s.direction_W[accessible]
        inside = self.field.fits(into)
        self.assertTrue(inside.collision.all())
        self.assertFalse(inside.free.any())
        self.assertEqual(set(inside.records.dtype.names), {"collisions", "collision_limit", "unknown_voxels", "valid"})
        bad = self.field.fits(np.full((2, 4, 4), np.eye(4)) * [[[2, 2, 2, 1]] * 3 + [[1, 1, 1, 1]]])
        self.assertFalse(bad.valid.any() or bad.free.any())
        way = self.field.fits_along(np.stack([T_WT[0], into[0]]))
        self.assertTrue(way.valid and way.collision and 0 <= way.first_hit < 1 and not way.free)
        self.assertTrue(np.isnan(way.fits_until) == (way.first_hit == 0))
        far = T_WT[:1].copy()
        far[:, :3, 3] += 30 * s.direction_W[accessible][:1]  # nobody saw what is there
        on = np.concatenate([into[:1], far])
        self.assertTrue(self.field.fits_along(on).collision)
        out = np.concatenate([T_WT[:1], far])
        out[0, :3, 3] += 0.3 * s.direction_W[accessible][0]
        ended = self.field.fits_along(out, unknown_blocks=True)
        self.assertTrue(ended.valid and ended.unknown and not ended.collision and not ended.free)
        self.assertTrue(np.isnan(ended.first_hit))
        self.assertTrue(np.isnan(ended.fits_until) or 0 <= ended.fits_until < 1)
        self.assertEqual(self.field.fits_along(out).fits_until, 1)
        self.assertEqual(len(self.field.fits(np.empty((0, 4, 4)))), 0)
        for wrong in (np.eye(4), np.zeros((2, 3, 4)), "no"):
            with self.assertRaises(accessvdb.InvalidArgument):
                self.field.fits(wrong)
        with self.assertRaises(accessvdb.UnusableInput):
            self.field.fits(np.ones((1, 4, 4)))
        with self.assertRaises(accessvdb.InvalidArgument):
            self.field.fits(T_WT, tool=3)

    def test_after_a_change(self):
        field = walls.field(frames=1)
        before = field.query([[3, 0.9, 0]])
        for n in range(1, 4):
            T_W_S = walls.pose(y=0.2 * n)
            field.integrate_scan(walls.scan(T_W_S, seed=n), T_W_S)
        field.update()
        after = field.query([[3, 0.9, 0]])
        self.assertGreater(after.weight[0], before.weight[0])

    def test_capsules(self):
        # Away from the wall, into the wall, into unobserved space, bad numbers.
        a_W = np.array([[2.95, -0.5, 0.0], [2.8, -0.5, 0.0], [4.0, 0, 0], [np.nan, 0, 0], [2.8, -0.5, 0]])
        b_W = np.array([[2.85, -0.5, 0.0], [3.2, -0.5, 0.0], [5.0, 0, 0], [1, 0, 0], [2.9, -0.5, 0]])
        answers = self.field.query_along(a_W, b_W, [0.001, 0.02, 0.1, 0.1, -1])
        np.testing.assert_array_equal(answers.valid, [True, True, True, False, False])
        np.testing.assert_array_equal(answers.collision[:3], [False, True, False])
        self.assertTrue(answers.unknown[2:].all())
        self.assertFalse(answers.free[1:].any())
        np.testing.assert_array_equal(answers.free, answers.valid & ~answers.collision & ~answers.unknown)
        # The wall is at 3, halfway; a voxel of 0.05 m and the radius make it earlier.
        self.assertTrue(0.3 < answers.first_hit_t[1] <= 0.55, answers.first_hit_t[1])
        one_for_all = self.field.query_along(a_W[:2], b_W[:2], 0.02)
        self.assertTrue(one_for_all.collision[1])
        self.assertEqual(len(self.field.query_along(np.empty((0, 3)), np.empty((0, 3)), 0.1)), 0)

    def test_misuse_of_capsules(self):
        a = np.zeros((4, 3))
        for b, radius in ((a[:3], 0.1), (a, [0.1, 0.2]), (a, None), (a, "0.1"), (a, [[0.1]] * 4), (None, 0.1), (a, True)):
            with self.subTest(radius=radius), self.assertRaises(accessvdb.InvalidArgument):
                self.field.query_along(a, b, radius)


class Approaches(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.field = walls.field()
        cls.snapshot = cls.field.snapshot()

    def test_distances_are_those_to_the_voxels_that_collide(self):
        low, high = [2.6, -0.5, 0.0], [3.1, 0.1, 0.4]
        grid = self.field.distance_grid(low, high, 0.5)
        self.assertEqual(grid.distance_m.shape, grid.known.shape)
        self.assertFalse(grid.distance_m.flags.writeable)
        v = grid.voxel_size_m
        index = np.argwhere(grid.distance_m == 0)
        self.assertGreater(len(index), 10)
        # A voxel that collides is where a surface point is, or beside one.
        centres = grid.first_W + v * index
        away = np.linalg.norm(centres[:, None] - self.snapshot.position_W[None], axis=2).min(axis=1)
        self.assertLess(away.max(), 3 * v)  # a point may be anywhere in its voxel
        every = grid.first_W + v * np.argwhere(grid.distance_m >= 0)
        far = np.linalg.norm(every[:, None] - centres[None], axis=2).min(axis=1)
        inside = grid.distance_m.ravel() < 0.1  # obstacles outside the box are no nearer there, or as near
        self.assertTrue((grid.distance_m.ravel()[inside] <= far[inside] + 1e-5).all())
        with self.assertRaises(accessvdb.InvalidArgument):
            self.field.distance_grid(high, low, 0.5)

    def test_arcs_are_those_of_accessible_points(self):
        arcs = self.field.free_arcs_deg(self.snapshot.id)
        reached = self.snapshot.label == accessvdb.PointLabel.ACCESSIBLE
        np.testing.assert_array_equal(arcs > 0, reached)
        self.assertEqual(arcs.dtype, np.float32)
        with self.assertRaises(accessvdb.InvalidArgument):
            self.field.free_arcs_deg([0, 0])

    def test_targets_are_accessible_points_with_poses(self):
        found = self.field.approaches(most=3, allow_unknown=True)
        self.assertLessEqual(len(found["targets"]), 3)
        reached = set(self.snapshot.id[self.snapshot.label == accessvdb.PointLabel.ACCESSIBLE].tolist())
        self.assertEqual(found["accessible_points"], len(reached))
        for target in found["targets"]:
            self.assertIn(target["point"], reached)
            for path in target["approaches"]:
                away = np.subtract(path["pre_contact"]["position"], path["contact"]["position"])
                self.assertAlmostEqual(np.linalg.norm(away), 8 * walls.VOXEL_M, places=6)
        with self.assertRaises(accessvdb.InvalidArgument):
            self.field.approaches(within_m=3)

    def test_views_are_refused_without_free_space_and_with_bad_values(self):
        for bad in ({"azimuth_deg": 0}, {"elevation_deg": 7}, {"elevation_deg": (5, 5)}, {"pitches_deg": []}, {"most": -1}):
            with self.assertRaises(accessvdb.InvalidArgument):
                self.field.views(**bad)
        with self.assertRaises(accessvdb.UnusableInput):
            self.field.views(body_radius_m=50)

    def test_margins_are_in_the_snapshot(self):
        tool = accessvdb.ToolGeometry.builtin("builtin:pruner")
        tools = accessvdb.with_margins([tool], [0, 2 * walls.VOXEL_M])
        self.assertEqual([t.tool.margin_m for t in tools], [0, 2 * walls.VOXEL_M])
        self.assertNotEqual(tool.grown_by(0.1).sha256, tool.sha256)
        with self.assertRaises(accessvdb.InvalidArgument):
            tool.grown_by(-1)


if __name__ == "__main__":
    unittest.main()
