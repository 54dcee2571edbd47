# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""A saved field goes on like the field itself; states that do not fit are refused by name."""

import tempfile
import unittest
from pathlib import Path

import accessvdb
import walls


def integrate(field, first, last):
    for n in range(first, last):
        T_W_S = walls.pose(y=0.2 * n)
        field.integrate_scan(walls.scan(T_W_S, seed=n), T_W_S)


class State(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.file = Path(cls.temporary.name) / "field.avst"
        cls.field = walls.field(frames=0)
        cls.tool = cls.field.tool

    def test_goes_on(self):
        straight = accessvdb.AccessibilityField(self.tool, {"tsdf": {"voxel_size_m": walls.VOXEL_M}})
        integrate(straight, 0, 2)
        straight.save_state(self.file)
        loaded = accessvdb.AccessibilityField.load_state(
            str(self.file), self.tool, backend="cpu", threads=1, fuse_on_host=True, device_cache_bytes=10**8
        )
        self.assertEqual(loaded.params.describe(), straight.params.describe())
        self.assertEqual((loaded.params.fuse_on_host, loaded.params.device_cache_bytes), (True, 10**8))
        for field in (straight, loaded):
            integrate(field, 2, 4)
            field.update()
        self.assertEqual(loaded.snapshot().records.tobytes(), straight.snapshot().records.tobytes())
        self.assertEqual(straight.snapshot().records.tobytes(), walls.field(frames=4).snapshot().records.tobytes())
        self.assertGreater((straight.snapshot().label == accessvdb.PointLabel.ACCESSIBLE).sum(), 50)

    def test_time(self):
        field = accessvdb.AccessibilityField(self.tool, {"tsdf": {"voxel_size_m": walls.VOXEL_M}})
        T_W_S = walls.pose(y=0.0)
        self.assertIsNone(field.latest_stamp_s)
        field.integrate_scan(walls.scan(T_W_S, seed=1), T_W_S)
        field.integrate_scan(walls.scan(T_W_S, seed=2), T_W_S, stamp_s=float("nan"))
        self.assertIsNone(field.latest_stamp_s)
        field.integrate_scan(walls.scan(T_W_S, seed=3), T_W_S, stamp_s=7.5)
        field.integrate_rays([[2.0, 0, 0]], [[0.0, 0, 0]], stamp_s=8.25)
        field.integrate_scan(walls.scan(T_W_S, seed=4), T_W_S, stamp_s=3)
        self.assertEqual(field.latest_stamp_s, 8.25)
        field.save_state(self.file)
        loaded = accessvdb.AccessibilityField.load_state(self.file, self.tool, backend="cpu", threads=1)
        self.assertEqual(loaded.latest_stamp_s, 8.25)
        with self.assertRaises(accessvdb.InvalidArgument):
            field.integrate_scan(walls.scan(T_W_S, seed=5), T_W_S, stamp_s="now")

    def test_refusals(self):
        self.field.save_state(self.file)
        load = accessvdb.AccessibilityField.load_state
        with self.assertRaises(accessvdb.UnusableInput) as caught:
            load(self.file, accessvdb.ToolGeometry.builtin("builtin:pencil"))
        self.assertEqual(caught.exception.id, "state.tool")
        content = self.file.read_bytes()
        self.file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
        with self.assertRaisesRegex(accessvdb.InputError, "scored") as caught:
            load(self.file, self.tool)
        self.assertEqual(caught.exception.id, "state.damaged")
        with self.assertRaises(accessvdb.InputError):
            load(self.file.with_name("none"), self.tool)
        with self.assertRaises(accessvdb.OutputError):
            self.field.save_state(self.file.parent / "no_folder" / "x")
        with self.assertRaises(accessvdb.InvalidArgument) as caught:
            walls.field(frames=0, update={"policy": "paper"}).save_state(self.file)
        self.assertEqual(caught.exception.id, "usage.checkpoint")
        for bad in ({"backend": "gpu"}, {"backend": 1}, {"threads": 1.5}, {"threads": -1}):
            with self.subTest(bad), self.assertRaises(accessvdb.InvalidArgument):
                self.file.write_bytes(content)
                load(self.file, self.tool, **bad)


if __name__ == "__main__":
    unittest.main()
