# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""StoredTiles against StoredField: a map in tiles, and the same map in one piece."""

import os
import shutil
import subprocess
import unittest
from pathlib import Path

import numpy as np

import accessvdb

WORK = Path(os.environ["WORK"], "stored_tiles")


def program(*arguments, which="PROGRAM"):
    subprocess.run([os.environ[which], *map(str, arguments), "--quiet"], check=True)


class StoredTiles(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        WORK.mkdir(parents=True)
        program("simulate", "--scene", "pine", "--frames", "6", "--out", WORK / "tree", which="LAB_PROGRAM")
        scans = ["--scans", WORK / "tree/scans", "--poses", WORK / "tree/poses.txt", "--tool", "builtin:pencil",
                 "--allow-hidden-tool"]
        for out, tiles in (("one", "off"), ("tiled", "6.4")):
            program("map", *scans, "--voxel", "0.05", "--device", "cpu", "--tiles", tiles, "--out", WORK / out)
        cls.one = accessvdb.StoredField(WORK / "one")
        cls.tiled = accessvdb.StoredTiles(WORK / "tiled")

    def test_all_points_are_there_once(self):
        self.assertTrue(self.tiled.complete)
        self.assertGreater(len(self.tiled.folders), 1)
        np.testing.assert_array_equal(self.tiled.origin_W, self.one.points.origin_W)
        self.assertEqual(self.tiled.voxel_size_m, self.one.points.voxel_size_m)
        one, tiled = self.one.points, self.tiled.overview(10**9)
        self.assertEqual(len(tiled), len(one))
        self.assertEqual(sum(len(accessvdb.StoredField(folder).points) for folder in self.tiled.folders), len(one))
        by_place = [np.lexsort(points.position_W.T) for points in (one, tiled)]
        for column in ("position_W", "label", "reason", "score"):
            np.testing.assert_array_equal(getattr(one, column)[by_place[0]], getattr(tiled, column)[by_place[1]])

    def test_an_overview_is_thinned(self):
        all_points = len(self.one.points)
        few = len(self.tiled.overview(all_points // 10))
        self.assertLessEqual(few, all_points // 10 + len(self.tiled.folders))
        self.assertGreater(few, all_points // 20)

    def test_answers_are_those_of_one_piece(self):
        shifts = np.random.default_rng(1).normal(0, 0.08, (40, 3))
        places = self.one.points.position_W[:: len(self.one.points) // 40][:40] + shifts
        found = 0
        for place in places:
            one, tiled = self.one.at(place), self.tiled.at(place)
            for name in ("observed", "cleared", "distance_m", "weight", "point_distance_m"):
                self.assertEqual(getattr(one, name), getattr(tiled, name), name)
            self.assertEqual(one.point is None, tiled.point is None)
            if one.point is not None:
                found += 1
                np.testing.assert_array_equal(one.point.position_W, tiled.point.position_W)
                self.assertEqual(one.point.label, tiled.point.label)
        self.assertGreater(found, 20)

    def test_what_has_changed_is_refused_unless_allowed(self):
        for source in ("one", "tiled"):
            shutil.copytree(WORK / source, WORK / ("changed_" + source))
        folder = WORK / "changed_tiled/tiles" / self.tiled.folders[0].name
        for file in (WORK / "changed_one/points.ply", folder / "points.ply"):
            # In a comment, so that it can still be read.
            file.write_bytes(file.read_bytes().replace(b"comment AccessVDB 0", b"comment AccessVDB 9", 1))
        tiled = accessvdb.StoredTiles(WORK / "changed_tiled")
        for read in (
            lambda: accessvdb.StoredField(WORK / "changed_one"),
            lambda: accessvdb.StoredField(folder),
            lambda: tiled.overview(10**9),
        ):
            with self.assertRaises(accessvdb.InputError) as caught:
                read()
            self.assertEqual(caught.exception.id, "output.changed")
        allowed = accessvdb.StoredField(WORK / "changed_one", allow_changed=True)
        self.assertEqual(len(allowed.points), len(self.one.points))
        allowed = accessvdb.StoredTiles(WORK / "changed_tiled", allow_changed=True)
        self.assertEqual(len(allowed.overview(10**9)), len(self.one.points))

    def test_a_folder_without_tiles_is_refused(self):
        with self.assertRaises(accessvdb.InputError) as caught:
            accessvdb.StoredTiles(WORK / "one")
        self.assertEqual(caught.exception.id, "field.missing")


if __name__ == "__main__":
    unittest.main()
