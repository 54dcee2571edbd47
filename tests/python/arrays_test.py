# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Arrays from users: every meaningful layout and type gives the same map, anything else a clear error and no
change."""

import unittest
from fractions import Fraction

import numpy as np

import accessvdb
import walls

T_W_S = walls.pose()
POINTS = walls.scan(T_W_S, rays=1500).astype(np.float32)


def empty_field():
    return accessvdb.AccessibilityField(
        accessvdb.ToolGeometry.builtin("builtin:pencil"), {"tsdf": {"voxel_size_m": 0.1}}
    )


def result(points_S, T=T_W_S):
    field = empty_field()
    stats = field.integrate_scan(points_S, T)
    field.update()
    return stats, field.snapshot().records.tobytes()


class GoodArrays(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.stats, cls.expected = result(POINTS)
        assert cls.stats.points_used == 1500

    def same(self, points_S, T=T_W_S):
        self.assertEqual(result(points_S, T)[1], self.expected)

    def test_layouts(self):
        wide = np.full((1500, 5), np.nan, np.float32)
        wide[:, 1:4] = POINTS
        self.same(wide[:, 1:4])  # columns of a wider array
        self.same(np.asfortranarray(POINTS))
        twice = np.repeat(POINTS, 2, axis=0)
        self.same(twice[::2])
        self.same(POINTS[::-1][::-1])
        read_only = POINTS.copy()
        read_only.setflags(write=False)
        self.same(read_only)
        unaligned = np.frombuffer(b"x" + POINTS.tobytes(), np.uint8)[1:].view(np.float32).reshape(-1, 3)
        self.assertFalse(unaligned.flags.aligned)
        self.same(unaligned)

    def test_types(self):
        self.same(POINTS.astype(np.float64))
        self.same(POINTS.astype(">f4"))
        self.same(POINTS.astype(np.longdouble))
        self.same(POINTS.tolist())
        self.same([tuple(row) for row in POINTS])
        self.same(POINTS, T_W_S.tolist())
        self.same(POINTS, T_W_S.astype(int))
        self.same(POINTS, np.asfortranarray(T_W_S))
        self.same(POINTS, T_W_S.astype(">f8"))

    def test_the_array_is_not_touched(self):
        copy = POINTS.copy()
        empty_field().integrate_scan(copy, T_W_S)
        np.testing.assert_array_equal(copy, POINTS)

    def test_whole_numbers(self):
        whole = np.array([[3, 0, 0], [3, 1, 0], [3, 1, 1]])
        self.assertEqual(result(whole)[1], result(whole.astype(np.float32))[1])

    def test_no_points(self):
        for none in ([], (), np.empty(0), np.empty((0, 3)), np.empty(0, np.float32), np.empty((0, 3), np.float32)):
            with self.subTest(repr(none)):
                stats = empty_field().integrate_scan(none, T_W_S)
                self.assertEqual((stats.points_in, stats.points_used), (0, 0))
        stats = empty_field().integrate_scan(np.empty((0, 3), np.float32), T_W_S)
        self.assertEqual((stats.points_in, stats.points_used), (0, 0))

    def test_bad_points_are_counted_and_not_used(self):
        bad = np.array([[np.nan, 1, 1], [np.inf, 0, 0], [0, 0, 0], [1e300, 0, 0], [-np.inf, np.nan, 1]])
        field = empty_field()
        stats = field.integrate_scan(np.vstack([POINTS, bad]), T_W_S)
        self.assertEqual(stats.points_in, 1505)
        self.assertEqual(stats.points_used, 1500)
        # 1e300 does not fit into float32: infinite.
        self.assertEqual(stats.dropped["non_finite"], 4)
        self.assertEqual(stats.dropped["no_return"], 1)
        field.update()
        self.assertEqual(field.snapshot().records.tobytes(), self.expected)

    def test_rays(self):
        # One origin for all, or one per ray.
        records = []
        for origins in (np.zeros((1, 3)), np.zeros_like(POINTS), [[0, 0, 0]]):
            field = empty_field()
            self.assertEqual(field.integrate_rays(POINTS, origins).points_used, 1500)
            field.update()
            records.append(field.snapshot().records.tobytes())
        self.assertEqual(records[0], records[1])
        self.assertEqual(records[0], records[2])
        with self.assertRaises(accessvdb.Error):
            empty_field().integrate_rays(POINTS, np.zeros((2, 3)))

    def test_a_large_array(self):
        points = np.zeros((3_000_000, 3))  # all "no return": nothing to fuse, all to read
        self.assertEqual(empty_field().integrate_scan(points, T_W_S).dropped["no_return"], 3_000_000)


class Refuses:
    """Not a number array of the right shape. The same table for every argument."""

    def __float__(self):
        raise RuntimeError("no")


def ragged():
    return [[1.0, 2.0, 3.0], [1.0, 2.0]]


MISUSE = [
    (None, "is None"),
    ("scan.pcd", "is of type str"),
    (b"123", "is of type bytes"),
    ({"x": 1}, "is of type dict"),
    (3.0, "shape ()"),
    ([], "shape (0,)"),
    (ragged(), "NumPy cannot convert to an array"),
    (object(), "type object"),
    ([[Fraction(1, 2)] * 3], "type object"),
    (iter([[1.0, 2.0, 3.0]]), "type object"),
    ([["1", "2", "3"]], "elements of type"),
    (np.array([["1", "2", "3"]]), "elements of type <U1"),
    (np.array([[b"1", b"2", b"3"]]), "elements of type |S1"),
    (np.array([[None, None, None]]), "elements of type object"),
    (np.zeros((4, 3), bool), "elements of type bool"),
    (np.zeros((4, 3), complex), "elements of type complex128"),
    (np.zeros((4, 3), "datetime64[s]"), "elements of type datetime64[s]"),
    (np.zeros(4, [("x", "f4"), ("y", "f4"), ("z", "f4")]), "elements of type"),
    (np.zeros(3, np.float32), "shape (3,)"),
    (np.zeros((3, 4), np.float32), "a[:, :3]"),
    (np.zeros((4, 2), np.float32), "shape (4, 2) instead of (N, 3)"),
    (np.zeros((1, 4, 3), np.float32), "shape (1, 4, 3)"),
    (np.float32(1), "shape ()"),
    (np.ma.masked_invalid(np.array([[1.0, np.nan, 2.0]])), "masked array"),
    (Refuses(), "type object"),
    (type, "type object"),
]


class Misuse(unittest.TestCase):
    def refused(self, text, call, *arguments):
        with self.assertRaises(accessvdb.InvalidArgument) as caught:
            call(*arguments)
        self.assertIn(text, str(caught.exception))
        self.assertEqual(caught.exception.code, 2)
        return caught.exception

    def test_points(self):
        field = empty_field()
        for bad, text in MISUSE:
            with self.subTest(repr(bad)[:60]):
                if not isinstance(bad, list) or bad:  # [] is a scan of no points
                    self.assertEqual(self.refused(text, field.integrate_scan, bad, T_W_S).subject, "points_S")
                self.assertEqual(self.refused(text, field.integrate_rays, bad, np.zeros((1, 3))).subject, "points_W")
                self.assertEqual(self.refused(text, field.integrate_rays, POINTS, bad).subject, "origins_W")
                self.assertEqual(self.refused(text, field.query, bad).subject, "points_W")
                self.assertEqual(self.refused(text, field.query_along, bad, POINTS, 0.1).subject, "a_W")
                self.refused(text, accessvdb.ToolGeometry.from_triangles, bad, [[0, 1, 2]])
        # None of that has left a trace.
        field.integrate_scan(POINTS, T_W_S)
        field.update()
        self.assertEqual(field.snapshot().records.tobytes(), result(POINTS)[1])

    def test_triangles(self):
        for bad, text in MISUSE:
            with self.subTest(repr(bad)[:60]):
                self.refused("triangles", accessvdb.ToolGeometry.from_triangles, POINTS, bad)
        for bad in ([[0, 1, -1]], [[0, 1, 2**40]], [[0.0, 1.0, 2.0]]):
            self.refused("triangles", accessvdb.ToolGeometry.from_triangles, POINTS, bad)
        with self.assertRaises(accessvdb.Error):  # an index without a vertex
            accessvdb.ToolGeometry.from_triangles(POINTS, [[0, 1, 10**6]])

    def test_poses(self):
        field = empty_field()
        for bad, _ in MISUSE:
            with self.subTest(repr(bad)[:60]):
                self.assertEqual(self.refused("", field.integrate_scan, POINTS, bad).subject, "T_W_S")
        self.refused("shape (3, 4) instead of (4, 4)", field.integrate_scan, POINTS, np.eye(4)[:3])
        for row, column in np.ndindex(4, 4):
            for spoil in (np.nan, np.inf):
                bad = np.eye(4)
                bad[row, column] = spoil
                with self.assertRaisesRegex(accessvdb.UnusableInput, "pose is not finite"):
                    field.integrate_scan(POINTS, bad)
        with self.assertRaisesRegex(accessvdb.UnusableInput, "pose is not finite"):
            field.integrate_scan(POINTS, np.full((4, 4), np.nan))
        for bad in (walls.pose(x=1e9), 2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.zeros((4, 4)), walls.pose(x=5).T):
            with self.assertRaises(accessvdb.UnusableInput):
                field.integrate_scan(POINTS, bad)
        self.assertEqual(len(field.snapshot()), 0)

    def test_single_positions(self):
        field = empty_field()
        for bad in (None, "abc", (1, 2), (1, 2, 3, 4), [[1, 2, 3]], (1, None, 3), ("1", "2", "3"), 7, object()):
            with self.subTest(repr(bad)):
                self.refused("p_W", field.point_at, bad)
        self.assertIsNone(field.point_at((np.nan, np.inf, 0)))

    def test_wrong_objects(self):
        field = empty_field()
        for bad in (None, "builtin:pencil", 3, field, np.zeros((3, 3))):
            with self.subTest(repr(bad)[:40]), self.assertRaises(TypeError):
                accessvdb.AccessibilityField(bad)
        for call in (
            lambda: field.integrate_scan(POINTS),
            lambda: field.integrate_scan(POINTS, T_W_S, 3),
            lambda: field.integrate_scan(POINTS, pose=T_W_S),
            lambda: field.integrate(POINTS),
            lambda: field.integrate(None),
            lambda: field.write(None),
            lambda: field.write(3),
            lambda: accessvdb.render_field("a.png", None),
            lambda: accessvdb.render_field("a.png", field),
            lambda: accessvdb.render_tool("a.png", None),
            lambda: accessvdb.FieldSnapshot(),
            lambda: accessvdb.ScanRecord(),
            lambda: accessvdb.ToolGeometry(),
            lambda: accessvdb.AccessibilityField.update(None),
            lambda: accessvdb.AccessibilityField.update(accessvdb.FieldParams()),
        ):
            with self.assertRaises(TypeError):
                call()


if __name__ == "__main__":
    unittest.main()
