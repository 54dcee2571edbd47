# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Snapshots: read-only columns without copies, alive as long as they are needed."""

import gc
import os
import tempfile
import unittest
import weakref

import numpy as np

import accessvdb
import walls

COLUMNS = {
    "id": (np.uint32, 1),
    "position_W": (np.float64, 3),
    "normal_W": (np.float32, 3),
    "direction_W": (np.float32, 3),
    "yaw_rad": (np.float32, 1),
    "direction": (np.uint16, 1),
    "roll": (np.uint8, 1),
    "tool": (np.uint8, 1),
    "tools": (np.uint32, 1),
    "margin_m": (np.float32, 1),
    "access_probability": (np.float32, 1),
    "score": (np.uint16, 1),
    "weight": (np.float32, 1),
    "confidence": (np.float32, 1),
    "stability": (np.float32, 1),
    "label": (np.uint8, 1),
    "reason": (np.uint8, 1),
    "confident": (np.bool_, 1),
}


class Snapshot(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.field = walls.field()
        cls.snapshot = cls.field.snapshot()

    def test_types_and_shapes(self):
        n = len(self.snapshot)
        self.assertGreater(n, 500)
        for name, (dtype, components) in COLUMNS.items():
            column = getattr(self.snapshot, name)
            self.assertEqual(column.dtype, dtype, name)
            self.assertEqual(column.shape, (n,) if components == 1 else (n, components), name)

    def test_no_copies(self):
        records = self.snapshot.records
        self.assertEqual(set(records.dtype.names), set(COLUMNS))
        for name in COLUMNS:
            column = getattr(self.snapshot, name)
            self.assertTrue(np.shares_memory(column, records), name)
            self.assertTrue(np.shares_memory(column, getattr(self.snapshot, name)), name)
            self.assertIs(column.base, self.snapshot, name)
            np.testing.assert_array_equal(column, records[name])

    def test_read_only(self):
        for name in [*COLUMNS, "records"]:
            column = getattr(self.snapshot, name)
            self.assertFalse(column.flags.writeable, name)
            with self.assertRaises(ValueError):
                column[0] = column[1]
            with self.assertRaises(ValueError):
                column.setflags(write=True)
        with self.assertRaises(AttributeError):
            self.snapshot.label = None

    def test_values_mean_something(self):
        s = self.snapshot
        np.testing.assert_array_equal(s.id, np.arange(len(s)))
        # Every return is on the wall, in the slot or on the floor. 1e-5 m: float32 in the sensor frame.
        x, y, z = s.position_W.T
        surface = (abs(x - 3) < 1e-5) | (abs(x - 3.3) < 1e-5) | (abs(z + 1) < 1e-5)
        self.assertTrue(surface.all())
        np.testing.assert_allclose(np.linalg.norm(s.normal_W[s.label != 0], axis=1), 1, atol=1e-5)
        reachable = s.label == accessvdb.PointLabel.ACCESSIBLE
        self.assertGreater(reachable.sum(), 100)
        np.testing.assert_allclose(s.direction_W[reachable][:, 0], np.cos(s.yaw_rad[reachable]), atol=1e-6)
        # Directions point out of the wall, towards the scanner.
        self.assertTrue((s.direction_W[reachable][:, 0] < 0).all())

    def test_how_the_tool_is_held(self):
        """World from tool: its first axis is the direction."""
        snapshot = walls.field(approach={"orientations": "sphere:30"}).snapshot()
        q = snapshot.orientation_WT
        self.assertEqual((q.shape, q.dtype), ((len(snapshot), 4), np.float32))
        w, x, y, z = q.T
        axis = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
        held = snapshot.direction != accessvdb.NO_DIRECTION
        np.testing.assert_allclose(axis[held], snapshot.direction_W[held], atol=1e-6)
        self.assertTrue((q[~held] == [1, 0, 0, 0]).all())
        self.assertGreater((abs(snapshot.direction_W[held][:, 2]) > 0.1).sum(), 50)

    def test_rolls(self):
        field = walls.field(approach={"orientations": "sphere:30", "rolls": 4})
        snapshot = field.snapshot()
        self.assertEqual(field.params.approach.rolls, 4)
        self.assertGreater((snapshot.roll > 0).sum(), 0)
        self.assertLess(snapshot.roll.max(), 4)
        at = int(np.argmax(snapshot.roll > 0))
        access = field.access_map(snapshot.position_W[at])
        best = snapshot.direction[at]
        self.assertEqual(access.roll.dtype, np.uint8)
        self.assertEqual((access.roll[best], access.point.roll), (snapshot.roll[at], snapshot.roll[at]))
        np.testing.assert_array_equal(access.orientation_WT[best], snapshot.orientation_WT[at])

    def test_access_map(self):
        field = walls.field(approach={"orientations": "sphere:30"})
        snapshot = field.snapshot()
        for label in (accessvdb.PointLabel.ACCESSIBLE, accessvdb.PointLabel.BLOCKED):
            at = int(np.argmax((snapshot.label == label) & (snapshot.score != accessvdb.NO_SCORE)))
            access = field.access_map(snapshot.position_W[at])
            self.assertEqual(access.point.id, at)
            self.assertEqual((access.direction_W.shape, access.orientation_WT.shape), ((54, 3), (54, 4)))
            self.assertEqual((access.reason.dtype, access.score.dtype), (np.uint8, np.uint16))
            best = snapshot.direction[at]
            np.testing.assert_array_equal(access.direction_W[best], snapshot.direction_W[at])
            self.assertEqual(access.score[best], snapshot.score[at])
            self.assertEqual(access.score.min(), snapshot.score[at])
            free = access.reason == accessvdb.PointReason.NONE
            self.assertEqual(free.any(), label == accessvdb.PointLabel.ACCESSIBLE)
            self.assertTrue((access.score[free] < access.collision_limit).all())
            self.assertIn(f"{free.sum()} of 54 directions free", repr(access))
        with tempfile.TemporaryDirectory() as folder:
            png = os.path.join(folder, "why.png")
            accessvdb.render_access_map(png, access)
            with open(png, "rb") as stream:
                self.assertEqual(stream.read(4), b"\x89PNG")
        self.assertIsNone(field.access_map([50, 0, 0]))

    def test_counts(self):
        s = self.snapshot
        for label in accessvdb.PointLabel:
            self.assertEqual(s.counts[label.name.lower()], (s.label == label).sum())
        for reason in accessvdb.PointReason:
            self.assertEqual(s.reasons[reason.name.lower()], (s.reason == reason).sum())
        self.assertGreater(s.counts["blocked"], 10)

    def test_arrays_outlive_snapshot_and_field(self):
        field = walls.field()
        snapshot = field.snapshot()
        records = snapshot.records
        label, position_W = snapshot.label, snapshot.position_W
        expected_label, expected_W = label.copy(), position_W.copy()
        gone = weakref.finalize(records, lambda: None)
        del records, snapshot, field
        gc.collect()
        self.assertFalse(gone.alive)
        other = [walls.field(frames=1).snapshot() for _ in range(3)]  # takes freed memory
        del other
        np.testing.assert_array_equal(label, expected_label)
        np.testing.assert_array_equal(position_W, expected_W)

    def test_snapshot_stays_as_it_was(self):
        field = walls.field(frames=1)
        before = field.snapshot()
        n, label = len(before), before.label.copy()
        T_W_S = walls.pose(y=0.6)
        field.integrate_scan(walls.scan(T_W_S, seed=9), T_W_S)
        field.update()
        self.assertGreater(len(field.snapshot()), n)
        self.assertEqual(len(before), n)
        np.testing.assert_array_equal(before.label, label)

    def test_empty(self):
        snapshot = accessvdb.AccessibilityField(accessvdb.ToolGeometry.builtin("builtin:pencil")).snapshot()
        self.assertEqual(len(snapshot), 0)
        self.assertEqual(sum(snapshot.counts.values()), 0)
        for name, (dtype, components) in COLUMNS.items():
            column = getattr(snapshot, name)
            self.assertEqual(column.dtype, dtype)
            self.assertEqual(column.shape, (0,) if components == 1 else (0, components))
        self.assertEqual(snapshot.records.shape, (0,))

    def test_point_at_is_the_same_point(self):
        index = int(np.flatnonzero(self.snapshot.label == accessvdb.PointLabel.ACCESSIBLE)[0])
        point = self.field.point_at(self.snapshot.position_W[index])
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(point, name), getattr(self.snapshot, name)[index], name)
        self.assertIs(point.label, accessvdb.PointLabel.ACCESSIBLE)
        self.assertIsNone(self.field.point_at((100, 100, 100)))

    def test_tool_arrays(self):
        tool = accessvdb.ToolGeometry.builtin("builtin:pruner")
        vertices_T, triangles = tool.vertices_T, tool.triangles
        self.assertFalse(vertices_T.flags.writeable or triangles.flags.writeable)
        again = accessvdb.ToolGeometry.from_triangles(vertices_T, triangles, "again")
        # Welded again, so in a different order.
        self.assertEqual(again.triangles.shape, triangles.shape)
        np.testing.assert_array_equal(np.unique(again.vertices_T, axis=0), np.unique(vertices_T, axis=0))
        self.assertEqual(again.name, "again")
        np.testing.assert_array_equal(tool.min_T, vertices_T.min(axis=0))
        np.testing.assert_array_equal(tool.max_T, vertices_T.max(axis=0))
        self.assertAlmostEqual(tool.reach_m, np.linalg.norm(vertices_T, axis=1).max(), places=6)
        expected = vertices_T.copy()
        del tool, again
        gc.collect()
        np.testing.assert_array_equal(vertices_T, expected)


if __name__ == "__main__":
    unittest.main()
