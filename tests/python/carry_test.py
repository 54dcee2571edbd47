# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""What returns carry, from arrays and from files, against counting by NumPy; it survives a saved state."""

import tempfile
import unittest
from collections import Counter
from pathlib import Path

import numpy as np

import accessvdb
import walls


def carrying(**params):
    params.setdefault("tsdf", {"voxel_size_m": walls.VOXEL_M})
    return accessvdb.AccessibilityField(
        accessvdb.ToolGeometry.builtin("builtin:pencil"), {"carry": ["tree", "species"], **params}
    )


class Carry(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.T_W_S = walls.pose()
        # In steps of a binary fraction, so that float32 and float64 have the same voxels.
        cls.points = np.round(walls.scan(cls.T_W_S) * 1024) / 1024
        random = np.random.default_rng(5)
        cls.rows = np.stack([random.integers(1, 4, len(cls.points)), random.integers(-2, 0, len(cls.points))], axis=1)
        cls.rows[::11, 0] = accessvdb.NO_ATTRIBUTE

    def test_is_what_most_returns_have(self):
        field = carrying()
        field.integrate_scan(self.points, self.T_W_S, attributes=self.rows)
        field.update()
        snapshot = field.snapshot()
        self.assertEqual(list(snapshot.attributes), ["tree", "species"])
        voxels = np.floor(self.points.astype(np.float32) * np.float32(1 / walls.VOXEL_M) + np.float32(0.5)).astype(int)
        votes = {}
        for voxel, row in zip(map(tuple, voxels), self.rows):
            for column, value in enumerate(row):
                if value != accessvdb.NO_ATTRIBUTE:
                    votes.setdefault((voxel, column), Counter())[value] += 1
        at = np.floor(
            snapshot.position_W.astype(np.float32) * np.float32(1 / walls.VOXEL_M) + np.float32(0.5)
        ).astype(int)
        for column, name in enumerate(snapshot.attributes):
            values = snapshot.attributes[name]
            self.assertFalse(values.flags.writeable)
            for voxel, value in zip(map(tuple, at), values):
                counts = votes.get((voxel, column), {accessvdb.NO_ATTRIBUTE: 1})
                most = max(counts.values())
                self.assertEqual(value, min(v for v, n in counts.items() if n == most))
        first = snapshot.position_W[0]
        self.assertEqual(field.attributes_at(first)["tree"], snapshot.attributes["tree"][0])
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "field.state"
            field.save_state(file)
            again = accessvdb.AccessibilityField.load_state(file, accessvdb.ToolGeometry.builtin("builtin:pencil"))
            self.assertEqual(again.params.carry, ("tree", "species"))
            for one in (field, again):
                one.integrate_scan(self.points, self.T_W_S, attributes=self.rows[::-1].copy())
            for name, values in field.snapshot().attributes.items():
                np.testing.assert_array_equal(values, again.snapshot().attributes[name])

    def test_from_files(self):
        with tempfile.TemporaryDirectory() as folder:
            scans = Path(folder) / "scans"
            scans.mkdir()
            lines = "".join(f"{p[0]} {p[1]} {p[2]} {row[1]}\n" for p, row in zip(self.points, self.rows))
            (scans / "0.pcd").write_text(
                "VERSION 0.7\nFIELDS x y z species\nSIZE 4 4 4 4\nTYPE F F F I\nCOUNT 1 1 1 1\n"
                f"WIDTH {len(self.points)}\nHEIGHT 1\nPOINTS {len(self.points)}\nDATA ascii\n{lines}"
            )
            record = accessvdb.ScanSequence(scans, carry=["species"])[0]
            np.testing.assert_array_equal(record.attributes[:, 0], self.rows[:, 1])
            field = carrying(carry=["kind"])
            field.integrate(record)
            self.assertEqual(set(field.snapshot().attributes["kind"]), {-2, -1})
            field.write(Path(folder) / "out")
            stored = accessvdb.StoredField(Path(folder) / "out").points
            np.testing.assert_array_equal(stored.attributes["kind"], field.snapshot().attributes["kind"])

    def test_misuse(self):
        field = carrying()
        for attributes, words in [
            (self.rows[:, :1], "6000 values"),
            (self.rows.astype(float), "whole numbers"),
            (self.rows.astype(np.int64) + 2**40, "32 bits"),
            ("tree", "whole numbers"),
        ]:
            with self.assertRaisesRegex(accessvdb.InvalidArgument, words):
                field.integrate_scan(self.points, self.T_W_S, attributes=attributes)
        self.assertEqual(len(field.snapshot()), 0)
        for carry in ("tree", [3], 5):
            with self.assertRaises(accessvdb.InvalidArgument):
                carrying(carry=carry)
        with self.assertRaisesRegex(accessvdb.InvalidArgument, "column of the results"):
            carrying(carry=["reason"])


if __name__ == "__main__":
    unittest.main()
