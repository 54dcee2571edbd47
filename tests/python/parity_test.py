# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The program (C++), the plug-in in C and Python give the same points, byte for byte, for the same scans."""

import os
import re
import subprocess
import unittest
from pathlib import Path

import numpy as np

import accessvdb

VOXEL_M = 0.1
SETTINGS = {"tsdf": {"voxel_size_m": VOXEL_M}}  # the plug-in in C also leaves everything else at its default
WORK = Path(os.environ["WORK"], "parity")
SCANS = WORK / "scans"


def run(*command):
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.PIPE)


def rows(folder):
    """points.ply without its header, which names the tool's file, among others."""
    return (Path(folder) / "points.ply").read_bytes().split(b"end_header\n", 1)[1]


def read_pcd(path):
    """(N, 3) float32 of a binary PCD with x y z first, read here, not by the library."""
    header, data = path.read_bytes().split(b"DATA binary\n", 1)
    lines = dict(line.split(" ", 1) for line in header.decode().splitlines() if not line.startswith("#"))
    names, sizes = lines["FIELDS"].split(), [int(size) for size in lines["SIZE"].split()]
    assert names[:3] == ["x", "y", "z"] and sizes[:3] == [4, 4, 4] and lines["TYPE"].split()[:3] == ["F"] * 3
    bytes_each = sum(size * int(count) for size, count in zip(sizes, lines["COUNT"].split()))
    raw = np.frombuffer(data, np.uint8, int(lines["POINTS"]) * bytes_each).reshape(-1, bytes_each)
    return np.ascontiguousarray(raw[:, :12]).view("<f4")


def read_poses(path):
    """TUM: stamp x y z qx qy qz qw -> (4, 4) each."""
    poses = []
    for line in path.read_text().splitlines():
        if line.startswith("#"):
            continue
        t = np.array(line.split()[1:4], float)
        x, y, z, w = np.array(line.split()[4:8], float)
        n = np.sqrt(x * x + y * y + z * z + w * w)
        x, y, z, w = x / n, y / n, z / n, w / n
        T = np.eye(4)
        T[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        T[:3, 3] = t
        poses.append(T)
    return poses


def new_field(settings=SETTINGS):
    return accessvdb.AccessibilityField(accessvdb.ToolGeometry.builtin("builtin:pruner"), settings)


class Parity(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        WORK.mkdir(parents=True, exist_ok=True)
        run(os.environ["MAKE_SAMPLE_SCANS"], "--out", SCANS, "--frames", 6, "--rays", 8000, "--seed", 3)
        run(os.environ["MAP_SCANS_IN_C"], os.environ["SHARED_LIBRARY"], SCANS, VOXEL_M, WORK / "c")
        run(os.environ["PROGRAM"], "map", "--scans", SCANS, "--poses", SCANS / "poses.txt", "--tool", "builtin:pruner",
            "--voxel", VOXEL_M, "--range-noise", 0.02, "--quiet", "--out", WORK / "cpp")  # fmt: skip
        cls.expected = rows(WORK / "cpp")

    def written(self, field, name):
        field.update()
        field.write(WORK / name)
        return rows(WORK / name)

    def test_the_comparison_says_something(self):
        snapshot = accessvdb.read_points_ply(WORK / "cpp" / "points.ply")
        self.assertGreater(snapshot.counts["accessible"], 50)
        self.assertGreater(snapshot.counts["blocked"], 50)
        self.assertEqual(rows(WORK / "c"), self.expected)

    def test_scans_that_the_library_reads(self):
        scans = accessvdb.ScanSequence(SCANS, SCANS / "poses.txt")
        self.assertEqual(len(scans), 6)
        field = new_field()
        for scan in scans:
            field.integrate(scan)
        self.assertEqual(self.written(field, "sequence"), self.expected)

    def test_arrays_of_a_sequence(self):
        field = new_field()
        for scan in accessvdb.ScanSequence(SCANS, SCANS / "poses.txt"):
            field.integrate_scan(scan.points_S, scan.T_W_S)
        self.assertEqual(self.written(field, "arrays"), self.expected)

    def test_arrays_read_here(self):
        paths = sorted(SCANS.glob("*.pcd"))
        poses = read_poses(SCANS / "poses.txt")
        self.assertEqual((len(paths), len(poses)), (6, 6))
        labels = {}
        for dtype in (np.float32, np.float64):
            field = new_field()
            for path, T_W_S in zip(paths, poses):
                stats = field.integrate_scan(read_pcd(path).astype(dtype), T_W_S)
                self.assertEqual(stats.points_in, 8000)
            field.update()
            snapshot = field.snapshot()
            labels[dtype] = snapshot.label.copy()
            # The poses are computed here, so the last bits of positions may differ; labels do not.
            table = accessvdb.read_points_ply(WORK / "cpp" / "points.ply")
            np.testing.assert_array_equal(snapshot.label, table.label)
            np.testing.assert_array_equal(snapshot.reason, table.reason)
            np.testing.assert_array_equal(snapshot.direction_W, table.direction_W)
            np.testing.assert_allclose(snapshot.position_W, table.position_W, atol=1e-5)
        np.testing.assert_array_equal(labels[np.float32], labels[np.float64])

    def test_threads_change_nothing(self):
        for threads in (1, 3):
            field = new_field({**SETTINGS, "threads": threads})
            for scan in accessvdb.ScanSequence(SCANS, SCANS / "poses.txt"):
                field.integrate(scan)
            self.assertEqual(self.written(field, f"threads{threads}"), self.expected)

    def test_updates_in_between_change_no_label(self):
        field = new_field()
        for scan in accessvdb.ScanSequence(SCANS, SCANS / "poses.txt"):
            field.integrate(scan)
            field.update()
        table = accessvdb.read_points_ply(WORK / "cpp" / "points.ply")
        # Labels are always exact; score, reason and stability of a blocked point depend on the updates.
        np.testing.assert_array_equal(field.snapshot().label, table.label)
        anew = field.evaluate_from_scratch()
        for name in ("label", "reason", "score", "direction_W"):
            np.testing.assert_array_equal(getattr(anew, name), getattr(table, name), name)

    def test_columns_equal_the_file(self):
        field = new_field()
        for scan in accessvdb.ScanSequence(SCANS, SCANS / "poses.txt"):
            field.integrate(scan)
        field.update()
        snapshot = field.snapshot()
        # The file, read by its own header.
        header = (WORK / "cpp" / "points.ply").read_bytes().split(b"end_header\n", 1)[0].decode()
        kinds = {"double": "<f8", "float": "<f4", "uchar": "u1", "ushort": "<u2", "uint": "<u4", "int": "<i4"}
        types = [(name, kinds[kind]) for kind, name in re.findall(r"^property (\w+) (\w+)$", header, re.MULTILINE)]
        table = np.frombuffer(self.expected, types)
        self.assertEqual(len(table), len(snapshot))
        for column, name in [(snapshot.label, "label"), (snapshot.reason, "reason"), (snapshot.score, "score"),
                             (snapshot.confidence, "confidence"), (snapshot.stability, "stability"),
                             (snapshot.access_probability, "access_probability"),
                             *zip(snapshot.position_W.T, "xyz"), *zip(snapshot.normal_W.T, ("nx", "ny", "nz")),
                             *zip(snapshot.direction_W.T, ("dx", "dy", "dz"))]:  # fmt: skip
            np.testing.assert_array_equal(column, table[name], name)


if __name__ == "__main__":
    unittest.main()
