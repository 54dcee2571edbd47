# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""blender_manifest.toml says what Blender 4.2 and later require, and the same as bl_info for those before.

The rules are those of Blender's manual, "How to Create Extensions": names, lengths, words."""

import ast
import os
import re
import tomllib
import unittest

from field_under_test import SOURCE, run_tests

FOLDER = os.path.join(SOURCE, "tools", "blender", "accessvdb_import")


class Manifest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        with open(os.path.join(FOLDER, "blender_manifest.toml"), "rb") as stream:
            cls.manifest = tomllib.load(stream)
        with open(os.path.join(FOLDER, "__init__.py"), encoding="utf-8") as stream:
            tree = ast.parse(stream.read())
        cls.bl_info = next(ast.literal_eval(line.value) for line in tree.body
                           if isinstance(line, ast.Assign) and line.targets[0].id == "bl_info")

    def test_it_has_what_is_required(self):
        m = self.manifest
        self.assertEqual(m["schema_version"], "1.0.0")
        self.assertEqual(m["type"], "add-on")
        self.assertRegex(m["id"], r"^[a-z][a-z0-9_]*$")
        self.assertEqual(m["id"], os.path.basename(FOLDER))
        self.assertRegex(m["version"], r"^\d+\.\d+\.\d+$")
        self.assertLessEqual(len(m["tagline"]), 64)
        self.assertRegex(m["tagline"], r"[A-Za-z0-9)]$")  # no full stop
        self.assertTrue(m["maintainer"])
        self.assertEqual(m["license"], ["SPDX:Apache-2.0"])
        self.assertEqual(m["blender_version_min"], "4.2.0")
        for name, reason in m["permissions"].items():
            self.assertIn(name, ("files", "network", "clipboard", "camera", "microphone"))
            self.assertLessEqual(len(reason), 64)
            self.assertRegex(reason, r"[A-Za-z0-9)]$")
        known = {"schema_version", "id", "version", "name", "tagline", "maintainer", "type", "tags", "license",
                 "blender_version_min", "permissions", "build"}
        self.assertLessEqual(set(m), known)

    def test_it_says_what_bl_info_says(self):
        self.assertEqual(self.manifest["name"], self.bl_info["name"])
        self.assertEqual(self.manifest["tags"], [self.bl_info["category"]])
        self.assertEqual(tuple(int(part) for part in self.manifest["version"].split(".")), self.bl_info["version"])
        self.assertLess(self.bl_info["blender"], (4, 2, 0))

    def test_modules_name_each_other_as_an_extension_has_to(self):
        # As an extension the package has another name, bl_ext.user_default.accessvdb_import.
        for name in sorted(os.listdir(FOLDER)):
            if not name.endswith(".py"):
                continue
            with open(os.path.join(FOLDER, name), encoding="utf-8") as stream:
                for line in ast.walk(ast.parse(stream.read())):
                    if isinstance(line, ast.Import):
                        self.assertFalse([part.name for part in line.names if "accessvdb" in part.name], name)
                    if isinstance(line, ast.ImportFrom) and line.level == 0:
                        self.assertNotIn("accessvdb", line.module, name)

    def test_the_documented_zip_holds_it(self):
        with open(os.path.join(SOURCE, "tools", "blender", "README.md"), encoding="utf-8") as stream:
            command, = re.findall(r"^cd tools/blender && zip .*$", stream.read(), re.MULTILINE)
        self.assertIn("'*.toml'", command)


run_tests()
