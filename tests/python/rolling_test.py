# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""A rolling field in Python has the points of a field, also where tiles leave memory, and goes on after a crash."""

import tempfile
import unittest
from pathlib import Path

import accessvdb
import numpy as np
import walls

PARAMS = {"tsdf": {"voxel_size_m": walls.VOXEL_M}, "backend": "cpu"}
STEPS = 12


def tool():
    return accessvdb.ToolGeometry.builtin("builtin:pruner")


def take(field, n):
    T_W_S = walls.pose(y=2.0 * n)
    field.integrate_scan(walls.scan(T_W_S, seed=n), T_W_S, stamp_s=0.1 * n)
    field.update()


class Rolling(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)

    def assert_same(self, a, b):
        self.assertEqual(len(a), len(b))
        for name in ("id", "position_W", "label"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
        accessible = a.label == accessvdb.PointLabel.ACCESSIBLE
        self.assertGreater(accessible.sum(), 50)
        for name in ("score", "direction"):
            np.testing.assert_array_equal(getattr(a, name)[accessible], getattr(b, name)[accessible], err_msg=name)

    def test_equals_a_field(self):
        whole = accessvdb.AccessibilityField(tool(), PARAMS)
        states = self.folder / "states"
        limits = {"folder": states, "memory_limit_bytes": 150_000_000, "tile_voxels": 128}
        rolling = accessvdb.RollingField([tool()], PARAMS, **limits)
        for n in range(STEPS):
            take(whole, n)
            take(rolling, n)
            if n == STEPS // 2:
                rolling.checkpoint()
        self.assert_same(whole.snapshot(), rolling.snapshot())
        status = rolling.status()
        self.assertEqual(status["steps"], STEPS)
        self.assertGreater(status["saved"], 0)
        self.assertFalse(status["lost_tiles"])

        del rolling  # as if it had been killed: what came after the checkpoint is gone
        with self.assertRaises(accessvdb.OutputError):
            accessvdb.RollingField([tool()], PARAMS, **limits)
        again = accessvdb.RollingField([tool()], PARAMS, resume=True, **limits)
        self.assertEqual(again.status()["steps"], STEPS // 2 + 1)
        for n in range(STEPS // 2 + 1, STEPS):
            take(again, n)
        self.assert_same(whole.snapshot(), again.snapshot())
        again.write(self.folder / "out")
        self.assertTrue((self.folder / "out" / "field.json").is_file())

    def test_refusals(self):
        with self.assertRaises(accessvdb.InvalidArgument):
            accessvdb.RollingField([tool()], PARAMS, folder=self.folder / "a", tile_voxels=100)
        with self.assertRaises(accessvdb.InputError):
            accessvdb.RollingField([tool()], PARAMS, folder=self.folder / "a", resume=True)
        with self.assertRaises(TypeError):
            accessvdb.RollingField([1], PARAMS, folder=self.folder / "a")


if __name__ == "__main__":
    unittest.main()
