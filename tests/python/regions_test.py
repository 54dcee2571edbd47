# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""What a cut would open equals removing it; regions that are none are refused by name."""

import tempfile
import unittest
from pathlib import Path

import numpy as np

import accessvdb
import walls


class Regions(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.field = walls.field(frames=4)
        # One side of the slot: with it gone, the tool reaches into the slot.
        cls.side = accessvdb.Region.box([2.8, 0.15, -0.9], [3.2, 0.8, 2])

    def copy(self):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "field.avst"
            self.field.save_state(file)
            return accessvdb.AccessibilityField.load_state(file, self.field.tool, backend="cpu")

    def test_what_if_equals_removing(self):
        before = self.field.snapshot()
        what_if = self.field.what_if([self.side])
        copy = self.copy()
        removal = copy.remove_region(self.side, removed_as="free")
        self.assertEqual(removal.removed_as, "free")
        self.assertEqual(removal.voxels, what_if.voxels)
        self.assertEqual(removal.points, what_if.points_gone)
        self.assertTrue((copy.snapshot().label == accessvdb.PointLabel.UNSCORED).all())
        copy.update()
        after = copy.snapshot()
        opened = before.id[
            (before.label == accessvdb.PointLabel.BLOCKED) & (after.label == accessvdb.PointLabel.ACCESSIBLE)
        ]
        self.assertEqual(what_if.opens.id.tolist(), opened.tolist())
        self.assertEqual(what_if.opens.direction.tolist(), after.direction[opened].tolist())
        self.assertEqual((after.reason == 7).sum(), what_if.points_gone)
        self.assertGreater(what_if.points_tried, len(what_if.opens))
        self.assertEqual(before.records.tobytes(), self.field.snapshot().records.tobytes())

    def test_unknown_opens_nothing(self):
        copy = self.copy()
        accessible = set(copy.snapshot().id[copy.snapshot().label == accessvdb.PointLabel.ACCESSIBLE])
        self.assertEqual(copy.remove_region(self.side).flipped_voxels, 0)
        copy.update()
        after = copy.snapshot()
        self.assertLess(set(after.id[after.label == accessvdb.PointLabel.ACCESSIBLE]), accessible)

    def test_other_regions(self):
        inside = self.field.snapshot()
        near = inside.id[np.linalg.norm(inside.position_W - [3, 0.4, 0], axis=1) < 0.4]
        by_points = self.field.what_if([accessvdb.Region.points(near)])
        self.assertGreaterEqual(by_points.points_gone, len(near))
        corner = np.array([2.7, 0.1, -0.5])
        vertices = corner + np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        tetrahedron = accessvdb.Region.mesh(vertices, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        self.assertGreater(self.field.what_if([tetrahedron]).voxels, 20)
        order = self.field.order_cuts([tetrahedron, self.side], most_cuts=1)
        self.assertLessEqual(len(order.cuts), 1)
        self.assertEqual(len(order.cuts) + len(order.left), 2)

    def test_refuses(self):
        def refused(error, id, call):
            with self.assertRaises(error) as raised:
                call()
            self.assertEqual(raised.exception.id, id)

        region = accessvdb.Region
        refused(accessvdb.InvalidArgument, "region.box", lambda: region.box([0, 0, np.nan], [1, 1, 1]))
        refused(accessvdb.InvalidArgument, "region.empty", lambda: region.points([]))
        refused(accessvdb.UnusableInput, "region.mesh", lambda: region.mesh([[0, 0, 0]], [[0, 0, 1]]))
        refused(accessvdb.UnusableInput, "region.ids", lambda: self.field.what_if([region.points([10**9])]))
        far = region.box([90, 90, 90], [91, 91, 91])
        refused(accessvdb.UnusableInput, "region.outside", lambda: self.field.what_if([far]))
        refused(accessvdb.InvalidArgument, "python.value", lambda: self.field.remove_region(far, removed_as="gone"))


if __name__ == "__main__":
    unittest.main()
