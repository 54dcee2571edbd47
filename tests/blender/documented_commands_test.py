# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The commands of tools/blender/README.md and docs/artists.md work, here with the field of the tests."""

import os
import re
import subprocess
import unittest

from field_under_test import FIELD, SOURCE, WORK, run_tests


class DocumentedCommands(unittest.TestCase):
    def ran(self, document, out):
        with open(os.path.join(SOURCE, document), encoding="utf-8") as stream:
            blocks = re.findall(r"```sh\n(.*?)```", stream.read(), re.DOTALL)
        commands = [block for block in blocks if block.startswith("blender --background")]
        self.assertEqual(len(commands), 1)
        command = commands[0].replace("blender --background", "blender --background --factory-startup")
        self.assertIn("out/demo/field\"", command)
        command = command.replace("out/demo/field\"", FIELD + "\"").replace("out/demo/", WORK + "/")
        if os.path.exists(out):
            os.remove(out)
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        done = subprocess.run(["bash", "-c", command], cwd=SOURCE, env=environment, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertTrue(os.path.isfile(out), done.stdout + done.stderr)
        return out

    def test_the_add_ons_readme(self):
        blend = self.ran("tools/blender/README.md", os.path.join(WORK, "field.blend"))
        self.assertGreater(os.path.getsize(blend), 100000)

    def test_the_page_for_artists(self):
        with open(self.ran("docs/artists.md", os.path.join(WORK, "field.png")), "rb") as stream:
            self.assertTrue(stream.read().startswith(b"\x89PNG"))


run_tests()
