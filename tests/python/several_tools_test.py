# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Several tools: each as alone, which of them reach a point, saving and going on, misuse."""

import os
import tempfile
import unittest

import numpy as np

import accessvdb
import walls

SPECS = [
    accessvdb.ToolSpec(accessvdb.ToolGeometry.builtin("builtin:pruner"), name="arm", max_collisions=-1),
    accessvdb.ToolSpec(accessvdb.ToolGeometry.builtin("builtin:pencil"), orientations="sphere:30"),
]


PARAMS = {"tsdf": {"voxel_size_m": walls.VOXEL_M}, "backend": "cpu"}


def filled(*tool, **tools_and_params):
    field = accessvdb.AccessibilityField(*tool, **tools_and_params)
    for n in range(3):
        T_W_S = walls.pose(y=0.2 * n)
        field.integrate_scan(walls.scan(T_W_S, seed=n), T_W_S)
    field.update()
    return field


class SeveralTools(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.field = filled(tools=SPECS, params=PARAMS)

    def test_each_is_as_alone(self):
        alone = [
            filled(SPECS[0].tool, dict(PARAMS, scoring={"max_collisions": -1})),
            filled(SPECS[1].tool, dict(PARAMS, approach={"orientations": "sphere:30"})),
        ]
        reach = np.zeros(len(self.field.snapshot().id), np.uint32)
        for k, field in enumerate(alone):
            expected, found = field.snapshot(), self.field.tool_snapshot(k)
            for column in ("label", "reason", "score", "direction", "stability"):
                np.testing.assert_array_equal(getattr(found, column), getattr(expected, column), f"{k} {column}")
            reach |= (expected.label == accessvdb.PointLabel.ACCESSIBLE).astype(np.uint32) << k
        snapshot = self.field.snapshot()
        np.testing.assert_array_equal(snapshot.tools, reach)
        accessible = snapshot.label == accessvdb.PointLabel.ACCESSIBLE
        np.testing.assert_array_equal(accessible, reach != 0)
        np.testing.assert_array_equal(snapshot.tool[accessible], np.where(reach[accessible] & 1, 0, 1))
        self.assertGreater(accessible.sum(), 0)
        point = self.field.point_at(snapshot.position_W[0])
        self.assertEqual((point.tool, point.tools), (snapshot.tool[0], snapshot.tools[0]))

    def test_names(self):
        self.assertEqual([spec.name for spec in self.field.tools], ["arm", "pencil"])
        self.assertEqual(self.field.tools[1].orientations, "sphere:30")
        self.assertEqual(self.field.tools[0].max_collisions, -1)
        self.assertIn("arm", repr(self.field.tools[0]))

    def test_saved_and_loaded(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "state")
            self.field.save_state(file)
            again = accessvdb.AccessibilityField.load_state(file, tools=SPECS, backend="cpu")
            np.testing.assert_array_equal(again.snapshot().tools, self.field.snapshot().tools)
            with self.assertRaisesRegex(accessvdb.UnusableInput, "other tools"):
                accessvdb.AccessibilityField.load_state(file, tools=SPECS[::-1], backend="cpu")

    def test_misuse(self):
        with self.assertRaises(TypeError):
            accessvdb.AccessibilityField()
        with self.assertRaises(TypeError):
            accessvdb.AccessibilityField(SPECS[0].tool, tools=SPECS)
        with self.assertRaises(TypeError):
            accessvdb.AccessibilityField(tools=["builtin:pencil"])
        with self.assertRaises(accessvdb.InvalidArgument):
            accessvdb.AccessibilityField(tools=[])
        with self.assertRaises(accessvdb.InvalidArgument):
            accessvdb.AccessibilityField(tools=[accessvdb.ToolSpec(SPECS[0].tool, name="a b")])
        with self.assertRaises(accessvdb.InvalidArgument):
            self.field.tool_snapshot(2)


if __name__ == "__main__":
    unittest.main()
