# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""A compiled module that this machine cannot load says in one line why, and what to do: whoever copied it by hand sees it."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import unittest
from pathlib import Path

import planted_symbols

PACKAGE = Path(os.environ["PACKAGE"])
SUFFIX = sysconfig.get_config_var("EXT_SUFFIX")


class ImportErrors(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.package = self.folder / "accessvdb"
        self.package.mkdir()
        for file in PACKAGE.glob("*.py"):
            shutil.copy(file, self.package)

    def said(self, code="import accessvdb; accessvdb.ToolGeometry"):
        ran = subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONPATH": str(self.folder)}, capture_output=True, text=True, check=False
        )
        return ran.returncode, (ran.stderr.splitlines() or [""])[-1]

    def test_too_old_a_system(self):
        for version, soname in (("GLIBC_2.99", "libm.so.6"), ("GLIBCXX_3.4.99", "libstdc++.so.6")):
            planted_symbols.needing(self.folder, version, soname, self.package / f"_accessvdb{SUFFIX}")
            code, line = self.said()
            self.assertEqual(code, 1)
            glibc = os.confstr("CS_GNU_LIBC_VERSION").split()[1]
            self.assertEqual(
                line,
                f"ImportError: accessvdb: this system is too old for this module: it has glibc {glibc} and lacks {version}. "
                "Use Debian 12, Ubuntu 22.04 or newer, or build it here: docs/python.md of the sources.",
            )
            # What starts programs only works all the same.
            self.assertEqual(self.said("import accessvdb.tiles; accessvdb.Error")[0], 0)

    def test_another_python(self):
        (self.package / "_accessvdb.cpython-39-x86_64-linux-gnu.so").touch()
        code, line = self.said()
        self.assertEqual(code, 1)
        self.assertRegex(
            line,
            "^ModuleNotFoundError: accessvdb: _accessvdb.cpython-39-x86_64-linux-gnu.so is for another Python; "
            f"this is {sys.implementation.cache_tag} on .*Install the wheel for it",
        )

    def test_anything_else_is_said_as_the_loader_says_it(self):
        self.assertEqual(self.said(), (1, "ModuleNotFoundError: No module named 'accessvdb._accessvdb'"))
        (self.package / f"_accessvdb{SUFFIX}").write_bytes(b"no library")
        self.assertIn("file too short", self.said()[1])


if __name__ == "__main__":
    unittest.main()
