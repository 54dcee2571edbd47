# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Errors: one base class, the classes and codes of accessvdb/error.h, one clear line each."""

import os
import pickle
import re
import tempfile
import unittest
from pathlib import Path

import numpy as np

import accessvdb
import walls

CODES = {
    "Usage": accessvdb.InvalidArgument,
    "Input": accessvdb.InputError,
    "Unusable": accessvdb.UnusableInput,
    "Resource": accessvdb.ResourceLimit,
    "Device": accessvdb.DeviceError,
    "Output": accessvdb.OutputError,
    "Internal": accessvdb.InternalError,
}


class Errors(unittest.TestCase):
    def raised(self, kind, id, call, *arguments):
        with self.assertRaises(accessvdb.Error) as caught:
            call(*arguments)
        error = caught.exception
        self.assertIs(type(error), kind)
        self.assertRegex(error.id, id)
        text = str(error)
        self.assertNotIn("\n", text)
        self.assertTrue(text.endswith("."), text)
        self.assertIn(error.problem, text)
        self.assertIn(error.subject, text)
        self.assertIn(error.advice, text)
        return error

    def test_classes_and_codes_are_those_of_the_header(self):
        header = Path(os.environ["SOURCE"], "include/accessvdb/error.h").read_text()
        enum = re.search(r"enum class ErrorCode[^{]*\{(.*?)\};", header, re.DOTALL).group(1)
        values = {name: int(value) for name, value in re.findall(r"(\w+) = (\d+)", enum)}
        self.assertEqual(set(values), set(CODES))
        aliases = dict(re.findall(r"using (\w+) = ErrorOf<ErrorCode::(\w+)>", header))
        self.assertEqual({alias: CODES[code].__name__ for alias, code in aliases.items()}, {a: a for a in aliases})
        for name, value in values.items():
            self.assertEqual(CODES[name].code, value)
            self.assertTrue(issubclass(CODES[name], accessvdb.Error))
        self.assertTrue(issubclass(accessvdb.InvalidArgument, ValueError))
        self.assertTrue(issubclass(accessvdb.ResourceLimit, MemoryError))

    def test_from_the_library(self):
        pencil = accessvdb.ToolGeometry.builtin("builtin:pencil")
        self.raised(accessvdb.InvalidArgument, "tool", accessvdb.ToolGeometry.builtin, "builtin:spoon")
        error = self.raised(
            accessvdb.InvalidArgument, "config.range", accessvdb.AccessibilityField, pencil, {"tsdf": {"voxel_size_m": 0}}
        )
        self.assertEqual(error.subject, "voxel_size_m")
        for threads in (-1, 4097, 70_000):
            error = self.raised(
                accessvdb.InvalidArgument, "config.range", accessvdb.AccessibilityField, pencil, {"threads": threads}
            )
            self.assertEqual(error.subject, "threads")
        self.raised(accessvdb.InputError, r"\w\.\w", accessvdb.ToolGeometry.from_mesh, "no such file.stl", "mm")
        flat = np.zeros((3, 3))
        self.raised(accessvdb.UnusableInput, "tool", accessvdb.ToolGeometry.from_triangles, flat, [[0, 1, 2]])
        self.raised(accessvdb.InputError, r"\w\.\w", accessvdb.StoredField, "/")
        self.raised(accessvdb.InputError, r"\w\.\w", accessvdb.read_points_ply, __file__)
        self.raised(accessvdb.InputError, r"\w\.\w", accessvdb.ScanSequence, "no such folder")
        # 19 m at half a millimetre: more voxels than are allowed. (A smaller one would be tried, and take the memory.)
        corners = np.array([[0, 0, 0], [19, 0, 0], [19, 0.1, 0], [19, 0, 0.1]])
        long = accessvdb.ToolGeometry.from_triangles(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        settings = {"tsdf": {"voxel_size_m": 0.0005, "range_noise_m": 0}}
        self.raised(accessvdb.ResourceLimit, "tool.span", accessvdb.AccessibilityField, long, settings)

    def test_outputs(self):
        field = walls.field(frames=1)
        with tempfile.TemporaryDirectory() as folder:
            blocker = Path(folder, "file")
            blocker.write_text("not a folder")
            error = self.raised(accessvdb.OutputError, "output", field.write, blocker)
            self.assertIn(str(blocker), error.subject)
            self.raised(accessvdb.OutputError, r"\w\.\w", accessvdb.render_field, blocker / "a.png", field.snapshot())

    def test_a_device_that_is_not_there(self):
        pencil = accessvdb.ToolGeometry.builtin("builtin:pencil")
        auto = accessvdb.AccessibilityField(pencil)
        if auto.device_name == "cpu":
            self.assertNotEqual(auto.device_note, "")
            self.raised(accessvdb.DeviceError, "device", accessvdb.AccessibilityField, pencil, {"backend": "cuda"})
        else:
            self.assertTrue(accessvdb.AccessibilityField(pencil, {"backend": "cuda"}).device_name.startswith("cuda:"))
        self.assertEqual(accessvdb.AccessibilityField(pencil, {"backend": "cpu"}).device_name, "cpu")

    def test_a_path_that_is_not_utf8(self):
        error = self.raised(accessvdb.InputError, r"\w\.\w", accessvdb.StoredField, b"/no such \xff folder")
        self.assertIn("\\xff", str(error))

    def test_pickles(self):
        error = accessvdb.UnusableInput("pose.last_row", "T_W_S", "is wrong", "Fix it")
        again = pickle.loads(pickle.dumps(error))
        self.assertIs(type(again), accessvdb.UnusableInput)
        self.assertEqual(str(again), "T_W_S: is wrong. Fix it.")
        self.assertEqual((again.id, again.code), ("pose.last_row", 4))


if __name__ == "__main__":
    unittest.main()
