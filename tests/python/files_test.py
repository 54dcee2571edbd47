# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Files: the output of write() can be read back, scans and meshes are read, pictures are drawn."""

import contextlib
import os
import sqlite3
import struct
import subprocess
import tempfile
import unittest
import zlib
from pathlib import Path

import numpy as np

import accessvdb
import walls


def openvdb_module():
    """OpenVDB's own module."""
    try:
        import pyopenvdb
    except ImportError:
        import openvdb as pyopenvdb  # its name since OpenVDB 12
    return pyopenvdb


def read_png(path):
    """(height, width, 3) uint8 of an 8-bit RGB PNG, decoded here."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, packed = 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + size]
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack(">IIBB", body[:10])
            assert (depth, colour) == (8, 2)
        packed += body if kind == b"IDAT" else b""
        at += size + 12
    lines = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 3 * width)
    picture = np.zeros((height + 1, width + 1, 3), int)  # a border of zeros, as the filters need
    for y in range(height):
        kind, line = lines[y, 0], lines[y, 1:].reshape(width, 3).astype(int)
        up, left_up = picture[y, 1:], picture[y, :-1]
        if kind == 0:
            picture[y + 1, 1:] = line
        elif kind == 1:
            picture[y + 1, 1:] = np.cumsum(line, axis=0) % 256
        elif kind == 2:
            picture[y + 1, 1:] = (line + up) % 256
        else:
            for x in range(width):
                a, b, c = picture[y + 1, x], up[x], left_up[x]
                if kind == 3:
                    guess = (a + b) // 2
                else:
                    p = a + b - c
                    da, db, dc = abs(p - a), abs(p - b), abs(p - c)
                    guess = np.where((da <= db) & (da <= dc), a, np.where(db <= dc, b, c))
                picture[y + 1, x + 1] = (line[x] + guess) % 256
    return picture[1:, 1:].astype(np.uint8)


class Files(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = Path(cls.temporary.name)
        cls.field = walls.field()
        cls.snapshot = cls.field.snapshot()
        cls.field.write(cls.folder / "field")

    def test_written_and_read_back(self):
        self.assertEqual(
            {path.name for path in (self.folder / "field").iterdir()}, {"field.vdb", "field_points.vdb", "points.ply"}
        )
        for again in (
            accessvdb.read_points_ply(self.folder / "field" / "points.ply"),
            accessvdb.StoredField(str(self.folder / "field")).points,
        ):
            for name in ("label", "reason", "position_W", "normal_W", "direction_W", "score", "confidence", "stability",
                         "access_probability"):
                np.testing.assert_array_equal(getattr(again, name), getattr(self.snapshot, name), name)
            self.assertEqual(again.voxel_size_m, self.snapshot.voxel_size_m)
            np.testing.assert_array_equal(again.origin_W, self.snapshot.origin_W)

    def test_stored_field(self):
        stored = accessvdb.StoredField(self.folder / "field")
        index = int(np.flatnonzero(self.snapshot.label == accessvdb.PointLabel.BLOCKED)[0])
        answer = stored.at(self.snapshot.position_W[index])
        self.assertTrue(answer.observed)
        self.assertIs(answer.point.label, accessvdb.PointLabel.BLOCKED)
        self.assertAlmostEqual(answer.point_distance_m, 0)
        live = self.field.query(self.snapshot.position_W[index : index + 1])
        self.assertAlmostEqual(answer.distance_m, float(live.distance_m[0]), places=6)
        self.assertEqual(answer.weight, live.weight[0])
        self.assertIsNone(stored.at((90, 90, 90)).point)
        points = stored.points
        label, expected = points.label, points.label.copy()
        del stored, points
        np.testing.assert_array_equal(label, expected)

    def test_a_map_beside_pyopenvdb(self):
        # Both modules load OpenVDB into one process.
        pyopenvdb = openvdb_module()

        grids = {grid.name: grid for grid in pyopenvdb.readAllGridMetadata(str(self.folder / "field" / "field.vdb"))}
        self.assertTrue({"density", "accessible", "distance", "weight"} <= set(grids))
        weight = pyopenvdb.read(str(self.folder / "field" / "field.vdb"), "weight")
        self.assertEqual(weight.activeVoxelCount(), self.field.memory_use().active_voxels)
        self.assertGreater(len(walls.field(frames=1).snapshot()), 100)

    def test_what_write_can_be_told(self):
        pyopenvdb = openvdb_module()

        def distance(folder):
            return pyopenvdb.read(str(folder / "field.vdb"), "distance")

        plain = distance(self.folder / "field")
        self.field.write(self.folder / "small", half_float=True, compression="zip", up_axis="y", surface=True)
        small = distance(self.folder / "small")
        self.assertTrue(small.saveFloatAsHalf)
        self.assertFalse(plain.saveFloatAsHalf)
        self.assertEqual(small.activeVoxelCount(), plain.activeVoxelCount())
        x, y, z = plain.transform.indexToWorld((10, 20, 30))
        np.testing.assert_allclose(small.transform.indexToWorld((10, 20, 30)), (x, z, -y), atol=1e-9)
        names = {grid.name for grid in pyopenvdb.readAllGridMetadata(str(self.folder / "small" / "field.vdb"))}
        self.assertIn("surface", names)
        self.field.write_frame(self.folder / "frame_0001.vdb")
        self.assertEqual(
            pyopenvdb.read(str(self.folder / "frame_0001.vdb"), "weight").activeVoxelCount(), plain.activeVoxelCount()
        )
        for bad in ({"half_float": 1}, {"compression": "gzip"}, {"compression": None}, {"up_axis": "x"}, {"surface": "no"}):
            with self.subTest(bad), self.assertRaises(accessvdb.InvalidArgument):
                self.field.write(self.folder / "never", **bad)
        self.assertFalse((self.folder / "never").exists())

    def test_scans_that_agree_and_poses_that_are_inverse(self):
        folder = self.folder / "agreeing"
        make = [os.environ["MAKE_SAMPLE_SCANS"], "--out", folder, "--frames", "12", "--rays", "6000"]
        subprocess.run(make, check=True, stdout=subprocess.PIPE)
        good = accessvdb.ScanSequence(folder, folder / "poses.txt").agreement()
        self.assertEqual((good.verdict, good.fault, good.scans, good.outliers), ("usual", None, 12, []))
        self.assertGreater(good.share, 0.97)
        lines = []
        for line in (folder / "poses.txt").read_text().splitlines():
            if line.startswith("#"):
                continue
            stamp, *numbers = line.split()
            x, y, z, qx, qy, qz, qw = map(float, numbers)
            v, p = np.array([-qx, -qy, -qz]), -np.array([x, y, z])
            p = p + 2 * np.cross(v, np.cross(v, p) + qw * p)
            lines.append(" ".join(map(repr, [float(stamp), *p.tolist(), *v.tolist(), qw])))
        (folder / "inverse.txt").write_text("\n".join(lines) + "\n")
        bad = accessvdb.ScanSequence(folder, folder / "inverse.txt").agreement()
        self.assertEqual((bad.verdict, bad.fault), ("disagree", "inverse"))
        one = accessvdb.ScanSequence(folder / "000000.pcd", sensor_at_W=(1, 2, 3)).agreement()
        self.assertEqual(one.verdict, "not_measured")
        self.assertTrue(one.why_not)

    def test_scans(self):
        scans_folder = self.folder / "scans"
        subprocess.run(
            [os.environ["MAKE_SAMPLE_SCANS"], "--out", scans_folder, "--frames", "3", "--rays", "500"],
            check=True,
            stdout=subprocess.PIPE,
        )
        scans = accessvdb.ScanSequence(scans_folder, scans_folder / "poses.txt")
        self.assertEqual(len(scans), 3)
        self.assertEqual(scans.recorded_range_noise_m, 0)
        self.assertTrue(scans.matching_rule and scans.notices)
        self.assertEqual(len([path for path in scans.paths if path.endswith(".pcd")]), 3)
        records = list(scans)
        self.assertEqual(len(records), 3)
        self.assertEqual(records[0].points_S.shape, (500, 3))
        self.assertEqual(records[0].points_W.shape, (0, 3))
        self.assertFalse(records[0].points_S.flags.writeable)
        np.testing.assert_allclose(records[2].T_W_S[:3, :3] @ records[2].T_W_S[:3, :3].T, np.eye(3), atol=1e-9)
        np.testing.assert_array_equal(records[2].points_S, scans[-1].points_S)
        for step in (3, -4, 10**15):
            with self.assertRaises(IndexError):
                scans[step]
        self.assertEqual(len(accessvdb.ScanSequence(scans_folder, scans_folder / "poses.txt", every=2)), 2)
        cloud = accessvdb.ScanSequence(scans_folder / "000000.pcd", sensor_at_W=(1, 2, 3))
        np.testing.assert_array_equal(cloud[0].origins_W, [[1, 2, 3]])
        self.assertGreater(len(cloud[0].points_W), 100)
        self.assertEqual(walls.field(frames=0).integrate(cloud[0]).points_in, len(cloud[0].points_W))
        for bad in ({"pose_format": "xyz"}, {"every": 0}, {"every": "2"}, {"sensor_at_W": (1, 2)}, {"sort_poses": 1}):
            with self.subTest(bad), self.assertRaises(accessvdb.InvalidArgument):
                accessvdb.ScanSequence(scans_folder, scans_folder / "poses.txt", **bad)

        turned = np.array([[0, -1, 0, 0.5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        box = ((-100, -100, -100), (0, 100, 100))
        moved = accessvdb.ScanSequence(scans_folder, scans_folder / "poses.txt", T_B_S=turned, exclude_box_S=box)[1]
        np.testing.assert_allclose(moved.T_W_S, records[1].T_W_S @ turned, atol=1e-12)
        behind = (records[1].points_S[:, 0] <= 0) & records[1].points_S.any(axis=1)
        self.assertEqual(moved.excluded_points, behind.sum())
        np.testing.assert_array_equal(moved.points_S, records[1].points_S[~behind])
        level = accessvdb.ScanSequence(scans_folder, scans_folder / "poses.txt", level=(0.1, -0.2))[1]
        roll = np.array([[1, 0, 0], [0, np.cos(0.1), -np.sin(0.1)], [0, np.sin(0.1), np.cos(0.1)]])
        pitch = np.array([[np.cos(-0.2), 0, np.sin(-0.2)], [0, 1, 0], [-np.sin(-0.2), 0, np.cos(-0.2)]])
        np.testing.assert_allclose(level.T_W_S[:3], pitch @ roll @ records[1].T_W_S[:3], atol=1e-12)
        self.assertFalse(records[1].deskewed)
        self.assertEqual(records[1].unposed_points, 0)
        above = accessvdb.ScanSequence(scans_folder / "000000.pcd", ray_W=(0, 0, -5))[0]
        returns = (above.origins_W != above.points_W).any(axis=1)  # the others are (0, 0, 0) in the file
        self.assertGreater(returns.sum(), 100)
        self.assertLess(returns.sum(), len(returns))
        np.testing.assert_array_equal(above.origins_W[returns], above.points_W[returns] + (0, 0, 5))
        for bad in (
            {"T_B_S": 2 * turned},
            {"exclude_box_S": box[::-1]},
            {"topic": "/points"},
            {"deskew": "on"},
            {"deskew": "perhaps"},
            {"level": "imu"},
            {"level": (np.nan, 0)},
        ):
            with self.subTest(bad), self.assertRaises(accessvdb.Error):
                accessvdb.ScanSequence(scans_folder, scans_folder / "poses.txt", **bad)
        with self.assertRaises(TypeError):
            accessvdb.ScanSequence(scans_folder, scans_folder / "poses.txt", exclude_box_S=box[0])
        with self.assertRaises(TypeError):
            accessvdb.ScanSequence(scans_folder, scans_folder / "poses.txt", level=0.1)

    def test_deskew(self):
        """A sensor that flies along x at 2 m/s, over a point that stands still."""
        folder = self.folder / "moving"
        (folder / "scans").mkdir(parents=True)
        times = np.arange(100, dtype=np.uint32) * 1_000_000
        points = np.zeros(100, [("xyz", "<f4", 3), ("t", "<u4")])
        points["t"] = times
        points["xyz"] = np.array([3, 1, 0.5]) - np.outer(2e-9 * times, [1, 0, 0])
        header = (
            "FIELDS x y z t\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 100\nHEIGHT 1\nPOINTS 100\nDATA binary\n"
        )
        (folder / "scans" / "100.0.pcd").write_bytes(header.encode() + points.tobytes())
        (folder / "poses.txt").write_text("".join(f"{100 + i / 10} {0.2 * i} 0 0 0 0 0 1\n" for i in range(3)))
        scans = accessvdb.ScanSequence(folder / "scans", folder / "poses.txt")
        self.assertIn("by the pose at its own time", scans.matching_rule)
        record = scans[0]
        self.assertTrue(record.deskewed)
        # Floats of 3 m are 2.4e-7 m apart.
        np.testing.assert_allclose(record.points_W, np.tile([3, 1, 0.5], (100, 1)), atol=1e-6)
        np.testing.assert_allclose(record.origins_W[:, 0], 2e-9 * times, atol=1e-9)
        off = accessvdb.ScanSequence(folder / "scans", folder / "poses.txt", deskew="off")[0]
        np.testing.assert_array_equal(off.points_S, points["xyz"])

    def test_recordings(self):
        """A database as rosbag2 writes it, here by sqlite3 and struct."""
        points = np.array([[1.5, 2, 3], [4, 5, 6]], np.float32)
        head = b"\0\1\0\0" + struct.pack("<iI", 1700000000, 250000000)
        pose = head + struct.pack("<I4s7d", 4, b"map\0", 7, 8, 9, 0, 0, 0, 1)
        fields = b"".join(struct.pack("<I4sIB3xI", 2, name, 4 * n, 7, 1) for n, name in enumerate((b"x", b"y", b"z")))
        cloud = head + struct.pack("<I8sIII", 5, b"body", 1, len(points), 3) + fields
        cloud += struct.pack("<B3xIII", 0, 12, 24, 24) + points.tobytes() + b"\1"
        file = self.folder / "flight.db3"
        with contextlib.closing(sqlite3.connect(file)) as database, database:
            database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)")
            database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
            types = ("sensor_msgs/msg/PointCloud2", "geometry_msgs/msg/PoseStamped")
            for n, (name, kind, data) in enumerate(zip(("/points", "/pose"), types, (cloud, pose))):
                database.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr')", (n, name, kind))
                database.execute("INSERT INTO messages VALUES(?, ?, 0, ?)", (n, n, data))
        scans = accessvdb.ScanSequence(file, topic="/points", pose_topic="/pose", fixed_frame="map")
        self.assertEqual((len(scans), scans.warnings), (1, []))
        np.testing.assert_array_equal(scans[0].points_S, points)
        np.testing.assert_array_equal(scans[0].T_W_S[:3, 3], [7, 8, 9])
        self.assertEqual(scans[0].stamp_s, 1700000000.25)
        with self.assertRaisesRegex(accessvdb.UnusableInput, "not connected"):
            accessvdb.ScanSequence(file, fixed_frame="odom")

    def test_surveys(self):
        points = [(1.5, 2, 3, 100.0625), (1.5, 4, 3, 100.125)]
        cloud = self.folder / "walk.ply"
        cloud.write_text(
            "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n"
            "property double time\nend_header\n" + "".join("%s %s %s %s\n" % point for point in points)
        )
        trajectory = self.folder / "walk.txt"
        trajectory.write_text("200 0 0 1\n200.125 0 8 1\n")
        with self.assertRaisesRegex(accessvdb.UnusableInput, "covers 0.0 %"):
            accessvdb.ScanSequence(cloud, trajectory=trajectory)
        walk = accessvdb.ScanSequence(cloud, trajectory=trajectory, time_offset_s=100)
        np.testing.assert_array_equal(walk[0].points_W, [point[:3] for point in points])
        np.testing.assert_array_equal(walk[0].origins_W, [[0, 4, 1], [0, 8, 1]])
        self.assertEqual(walk[0].stamp_s, 200.0625)
        stations = self.folder / "stations.txt"
        stations.write_text("walk.ply 7 8 9\n")
        np.testing.assert_array_equal(accessvdb.ScanSequence(cloud, stations=stations)[0].origins_W, [[7, 8, 9]])
        packed = self.folder / "scan.laz"
        packed.write_bytes(b"LASF")
        with self.assertRaisesRegex(accessvdb.InputError, "exit code 1"):
            accessvdb.ScanSequence(packed, sensor_at_W=(0, 0, 0), laz_command="false")
        for bad in ({"time_offset_s": float("nan")}, {"time_offset_s": "1"}, {"stations": stations}):
            with self.subTest(bad), self.assertRaises(accessvdb.InvalidArgument):
                accessvdb.ScanSequence(cloud, trajectory=trajectory, **bad)

    def test_a_mesh(self):
        path = self.folder / "box.obj"
        corners = [(40 * (n & 1), 20 * (n >> 1 & 1), 10 * (n >> 2 & 1)) for n in range(8)]
        faces = ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"]
        path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {f}\n" for f in faces))
        tool = accessvdb.ToolGeometry.from_mesh(path, "mm", tip=(40, 10, 5), axis=(-1, 0, 0), up=(0, 1, 0))
        np.testing.assert_allclose(tool.min_T, [0, -0.005, -0.01], atol=1e-7)
        np.testing.assert_allclose(tool.max_T, [0.04, 0.005, 0.01], atol=1e-7)
        self.assertTrue(tool.watertight)
        self.assertEqual(tool.opening_m, 0)
        self.assertGreater(accessvdb.ToolGeometry.from_triangles(tool.vertices_T, tool.triangles[1:]).opening_m, 0.001)
        with self.assertRaisesRegex(accessvdb.InvalidArgument, "unit"):
            accessvdb.ToolGeometry.from_mesh(path)
        for bad in ({"unit": "km"}, {"unit": 3}, {"unit": "m", "axis": (0, 0, 0)}, {"unit": "m", "tip": (1, 2)}):
            with self.subTest(bad), self.assertRaises(accessvdb.InvalidArgument):
                accessvdb.ToolGeometry.from_mesh(path, **bad)

    def test_pictures(self):
        path = self.folder / "field.png"
        accessvdb.render_field(path, self.snapshot, width_px=160, height_px=120, view_W=(-1, 0, 0.3))
        picture = read_png(path).astype(int)
        self.assertEqual(picture.shape, (120, 160, 3))
        red, green, _ = np.moveaxis(picture, 2, 0)
        self.assertGreater((green > red + 40).sum(), 100)  # the reachable wall
        accessvdb.render_tool(self.folder / "tool.png", self.field.tool, width_px=200, height_px=150)
        self.assertEqual(read_png(self.folder / "tool.png").shape, (150, 200, 3))
        for bad in ({"width_px": 0}, {"height_px": 10**9}, {"view_W": (0, 0, 0)}, {"view_W": (np.nan, 0, 0)}, {"width_px": 1.5}):
            with self.subTest(bad), self.assertRaises(accessvdb.InvalidArgument):
                accessvdb.render_field(path, self.snapshot, **bad)


if __name__ == "__main__":
    unittest.main()
