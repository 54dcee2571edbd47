# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""What makes a wheel run elsewhere: its libraries come along and are the ones that are loaded, and symbols newer than those
of Ubuntu 22.04 are refused by name. The module is the one that was built."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import planted_symbols

SOURCE, PACKAGE = Path(os.environ["SOURCE"]), Path(os.environ["PACKAGE"])
sys.path.insert(0, str(SOURCE / "python/build_backend"))
import portable_wheel  # noqa: E402

MACHINE = os.uname().machine
# Prints what is loaded, and labels.
PROBE = """
import sys
{before}
import numpy as np
import accessvdb
{after}
field = accessvdb.AccessibilityField(accessvdb.ToolGeometry.builtin("builtin:pencil"), {{"tsdf": {{"voxel_size_m": 0.05}}}})
points = np.stack([np.full(900, 2.0), *np.random.default_rng(1).uniform(-1, 1, (2, 900))], axis=1)
field.integrate_scan(points, np.eye(4))
field.update()
import hashlib
print(field.snapshot().counts["accessible"], hashlib.sha256(field.snapshot().position_W.tobytes() + field.snapshot().label.tobytes()).hexdigest())
print(*sorted({{line.split()[-1] for line in open("/proc/self/maps") if ".so" in line}}), sep="\\n")
"""


def probe(path, before="", after=""):
    ran = subprocess.run(
        [sys.executable, "-c", PROBE.format(before=before, after=after)],
        env={"PYTHONPATH": str(path)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if ran.returncode != 0:
        raise AssertionError(f"code {ran.returncode}: {ran.stderr}")
    labels, *loaded = ran.stdout.splitlines()
    return labels, loaded


@unittest.skipIf(shutil.which("patchelf") is None, "patchelf is missing")
class Bundle(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.tree = Path(folder.name).resolve()
        shutil.copytree(PACKAGE, cls.tree / "accessvdb", ignore=shutil.ignore_patterns("__pycache__"))
        (cls.module,) = (cls.tree / "accessvdb").glob("_accessvdb.*.so")
        subprocess.run(["strip", cls.module], check=True)
        try:
            cls.platform, cls.libraries = portable_wheel.bundle(cls.tree, cls.module, MACHINE)
        except portable_wheel.NotPortable as error:
            if "Build it on" not in str(error):
                raise
            raise unittest.SkipTest(str(error)) from None  # this distribution is newer
        cls.bundled = sorted((cls.tree / "accessvdb.libs").iterdir())

    def test_is_all_that_is_loaded(self):
        labels, loaded = probe(self.tree)
        self.assertGreater(int(labels.split()[0]), 100)
        self.assertEqual(labels, probe(PACKAGE.parent)[0])
        ours = {file for file in loaded if file.startswith(str(self.tree))}
        self.assertEqual(ours, {str(self.module), *map(str, self.bundled)})
        self.assertGreater(len(ours), 10)
        for file in set(loaded) - ours:
            known = r"/(ld-linux[^/]*|lib(c|m|stdc\+\+|gcc_s|dl|rt|pthread)|lib(python|expat|z|crypto|ssl|ffi|blas|lapack|gfortran|quadmath|openblas|bz2|lzma|uuid|mpdec|pthread).*)\.so|python3|site-packages|dist-packages"
            self.assertRegex(file, known)
            self.assertNotRegex(file, "openvdb|tbb|assimp|Imath|blosc|png|sqlite|zstd|lz4|lzf")

    def test_names_are_of_nobody_else(self):
        self.assertEqual(len(self.bundled), len(self.libraries))
        for file in self.bundled:
            self.assertRegex(file.name, r"^lib.+-[0-9a-f]{8}\.so")
            head = subprocess.run(["readelf", "-d", file], check=True, capture_output=True, text=True).stdout
            self.assertIn(f"Library soname: [{file.name}]", head)

    def test_beside_the_distributions_openvdb(self):
        """Its module for Python has the same symbols, and some of them are one in the whole process."""
        labels = probe(PACKAGE.parent)[0]
        use = "import pyopenvdb; g = pyopenvdb.FloatGrid(); g.fill((0, 0, 0), (9, 9, 9), 1.0); assert g.activeVoxelCount() == 1000"
        if subprocess.run([sys.executable, "-c", "import pyopenvdb"], capture_output=True, check=False).returncode:
            self.skipTest("no pyopenvdb")
        self.assertEqual(probe(self.tree, before=use)[0], labels)
        self.assertEqual(probe(self.tree, after=use)[0], labels)

    @unittest.skipIf(shutil.which("dpkg-query") is None, "no dpkg")
    def test_licences(self):
        out = self.tree / "licences"
        subprocess.run([SOURCE / "tools/collect_licences.sh", out, *self.libraries], check=True)
        self.assertEqual((out / "accessvdb").read_bytes(), (SOURCE / "LICENSE").read_bytes())
        packages = subprocess.run(
            ["dpkg", "-S", *{str(path.resolve()).replace("/lib/", "/usr/lib/", 1).replace("/usr/usr", "/usr") for path in self.libraries}],
            capture_output=True, text=True, check=False,
        ).stdout  # fmt: skip
        owners = {line.split(":")[0] for line in packages.splitlines()}
        self.assertGreater(len(owners), 5)
        for package in owners:
            self.assertTrue((out / package).read_text(errors="replace").strip(), package)


class Symbols(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def test_tag_of_the_module_that_was_built(self):
        """By readelf, in place of objdump."""
        (module,) = PACKAGE.glob("_accessvdb.*.so")
        files = [module, *portable_wheel.libraries_of(module).values()]
        self.assertGreater(len(files), 10)
        newest = (0, 0)
        for file in files:
            text = subprocess.run(["readelf", "-V", "--wide", file], check=True, capture_output=True, text=True).stdout
            for major, minor in re.findall(r"Name: GLIBC_(\d+)\.(\d+)", text):
                newest = max(newest, (int(major), int(minor)))
        try:
            self.assertEqual(portable_wheel.platform_tag(files, MACHINE), f"manylinux_{newest[0]}_{newest[1]}_{MACHINE}")
        except portable_wheel.NotPortable as error:
            self.assertIn("and a wheel may need at most", str(error))
            self.skipTest(str(error))  # this distribution is newer

    def test_newer_ones_are_refused_by_name(self):
        for version, soname, newest in (
            ("GLIBC_2.36", "libc.so.6", "GLIBC_2.35"),
            ("GLIBC_2.100", "libm.so.6", "GLIBC_2.35"),
            ("GLIBCXX_3.4.31", "libstdc++.so.6", "GLIBCXX_3.4.30"),
            ("CXXABI_1.3.14", "libstdc++.so.6", "CXXABI_1.3.13"),
            ("GCC_13.0.0", "libgcc_s.so.1", "GCC_12.0.0"),
        ):
            planted = planted_symbols.needing(self.folder, version, soname)
            with self.assertRaises(portable_wheel.NotPortable) as caught:
                portable_wheel.platform_tag([planted], MACHINE)
            self.assertEqual(
                str(caught.exception),
                f"planted.so needs {version}, and a wheel may need at most {newest}. Build it on Debian 12",
            )

    def test_the_newest_of_all_files_counts(self):
        files = []
        for n, version in enumerate(("GLIBC_2.4", "GLIBC_2.35", "GLIBC_2.9")):
            files.append(planted_symbols.needing(self.folder, version, "libc.so.6", f"planted{n}.so"))
        self.assertEqual(portable_wheel.platform_tag(files, "x86_64"), "manylinux_2_35_x86_64")
        self.assertEqual(portable_wheel.platform_tag(files[2:], "aarch64"), "manylinux_2_17_aarch64")

    def test_a_library_that_is_missing_is_named(self):
        planted = planted_symbols.needing(self.folder, "OURS_1", "libnowhere.so.3")
        with self.assertRaisesRegex(portable_wheel.NotPortable, "^libnowhere.so.3, which the module needs, is not found. "):
            portable_wheel.libraries_of(planted)

    def test_a_program_that_is_missing_is_named(self):
        with self.assertRaisesRegex(portable_wheel.NotPortable, "'no-such-program' is missing. On Debian and Ubuntu: apt install "):
            portable_wheel.output_of("no-such-program")


if __name__ == "__main__":
    unittest.main()
