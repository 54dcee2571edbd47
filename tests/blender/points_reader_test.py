# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The add-on's own reader of points.ply, without Blender: against a reader written here, and against damaged files."""

import json
import os
import re
import struct
import unittest

import numpy as np

from accessvdb_import.field_folder import FieldFolder, tool_of_run
from accessvdb_import.points_ply import COLUMNS, LABELS, PROBABILITY, REASONS, FieldError, read_points
from field_under_test import FIELD, POINTS, WORK, run_tests

# Layout of a record as in docs/file_formats.md, deliberately repeated here.
_RECORD = struct.Struct("<3d3f3B2BH2f3fff")


def altered(change):
    """Path of a copy of points.ply with its bytes passed through `change`."""
    with open(POINTS, "rb") as stream:
        data = stream.read()
    path = os.path.join(WORK, "altered_points.ply")
    with open(path, "wb") as stream:
        stream.write(change(data))
    return path


class PointsReader(unittest.TestCase):
    def test_every_value_is_read(self):
        with open(POINTS, "rb") as stream:
            data = stream.read()
        body = data[data.index(b"end_header\n") + 11:]
        points = read_points(POINTS)
        self.assertEqual(len(points) * _RECORD.size, len(body))
        self.assertGreater(len(points), 1000)
        for row, values in enumerate(_RECORD.iter_unpack(body)):
            self.assertEqual(values, tuple(points.records[row][name].item() for name in (*COLUMNS, PROBABILITY)))

    def test_every_reason_and_label_is_known(self):
        header = os.path.join(os.path.dirname(__file__), "../../include/accessvdb/point_label.h")
        with open(header, encoding="utf-8") as stream:
            lists = re.findall(r"kNames\[\w+\] = \{([^}]*)\}", stream.read())
        labels, reasons = (tuple(re.findall(r'"(\w+)"', text)) for text in lists)
        self.assertEqual((LABELS, REASONS), (labels, reasons))

    def test_counts_are_those_of_the_report(self):
        with open(os.path.join(FIELD, "report.json"), encoding="utf-8") as stream:
            counts = json.load(stream)["counts"]
        labels = np.bincount(read_points(POINTS).records["label"], minlength=3)
        self.assertEqual(labels.tolist(), [counts["unscored"], counts["accessible"], counts["blocked"]])
        self.assertTrue(counts["accessible"] > 100 and counts["blocked"] > 100)

    def test_the_tool_of_a_point_is_that_of_several(self):
        folder = os.path.join(WORK, "several_tools")
        os.makedirs(folder, exist_ok=True)

        def with_tools(data):
            end = data.index(b"end_header\n")
            body = data[end + 11:]
            rows = len(body) // _RECORD.size
            tail = [struct.pack("<BI", row % 2, 1 << row % 2) for row in range(rows)]
            records = b"".join(body[row * _RECORD.size:(row + 1) * _RECORD.size] + tail[row] for row in range(rows))
            return data[:end] + b"property uchar tool\nproperty uint tools\nend_header\n" + records

        points = read_points(altered(with_tools))
        self.assertEqual([points.best_tool(row) for row in range(4)], [0, 1, 0, 1])
        self.assertEqual(points.records["tools"][1], 2)
        self.assertEqual(read_points(POINTS).best_tool(1), 0)
        report = os.path.join(folder, "report.json")
        names = ("tool_unit", "tool_tip", "tool_axis", "tool_up")
        tools = [dict.fromkeys(names, "") | {"tool": "builtin:" + name} for name in ("pencil", "pruner")]
        with open(report, "w", encoding="utf-8") as stream:
            json.dump({"parameters": {"tool": "builtin:pencil, builtin:pruner"}, "tools": tools}, stream)
        field = FieldFolder(folder, "", "", report)
        self.assertEqual(tool_of_run(field, points.best_tool(1))[0], "builtin:pruner")
        self.assertEqual(tool_of_run(field, points.best_tool(2))[0], "builtin:pencil")
        with self.assertRaises(FieldError):
            tool_of_run(field, 2)

    def assertRefused(self, path, words):
        with self.assertRaises(FieldError) as refusal:
            read_points(path)
        self.assertIn(words, str(refusal.exception))
        self.assertIn(path, str(refusal.exception))
        self.assertEqual(len(str(refusal.exception).splitlines()), 1)

    def test_files_that_are_not_ours_are_refused(self):
        self.assertRefused(os.path.join(WORK, "none.ply"), "No such file")
        self.assertRefused(WORK, "Is a directory")
        self.assertRefused(os.path.join(WORK, "hook.stl"), "no PLY header")
        self.assertRefused(altered(lambda data: b""), "no PLY header")
        self.assertRefused(altered(lambda data: data.replace(b"binary_little_endian", b"ascii")), "format ascii")
        self.assertRefused(altered(lambda data: data.replace(b"float yaw", b"float jaw")), "columns missing: yaw")
        self.assertRefused(altered(lambda data: data.replace(b"float dx", b"list uchar int dx")), "list uchar int dx")
        self.assertRefused(altered(lambda data: data.replace(b"comment origin_W", b"comment origin")), "origin_W")
        self.assertRefused(altered(lambda data: data.replace(b"voxel_size_m 0", b"voxel_size_m -0")), "voxel size")

    def test_damaged_files_are_refused(self):
        count = len(read_points(POINTS))
        self.assertRefused(altered(lambda data: data[:-1]), f"{count} points of {_RECORD.size} bytes")
        self.assertRefused(altered(lambda data: data + b"x"), f"{count} points of {_RECORD.size} bytes")
        told, huge = b"element vertex %d" % count, b"element vertex 999999999999999"
        self.assertRefused(altered(lambda data: data.replace(told, huge)), "999999999999999 points")

        def with_value(row, offset, value):
            def change(data):
                at = data.index(b"end_header\n") + 11 + row * _RECORD.size + offset
                return data[:at] + value + data[at + len(value):]
            return change
        self.assertRefused(altered(with_value(5, 0, struct.pack("<d", float("nan")))), "point 5 has no finite position")
        self.assertRefused(altered(with_value(7, 39, b"\x09")), "point 7 has label 9")
        self.assertRefused(altered(with_value(8, 40, b"\x09")), "point 8 has reason 9")


run_tests()
