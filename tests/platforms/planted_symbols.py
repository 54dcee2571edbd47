# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Shared libraries that need symbols which no system has."""

import os
import subprocess
from pathlib import Path


def needing(folder, version, soname, made="planted.so"):
    """A library `made` that needs a symbol of a version, "GLIBC_2.99", of the library `soname`."""
    folder = Path(folder)
    there = folder / "there"
    there.mkdir(exist_ok=True)
    cc = [os.environ["CC"], "-shared", "-fPIC", "-nostdlib"]
    (there / "symbols.map").write_text(f"{version} {{ global: planted; }};")
    (there / "planted.c").write_text("int planted(void) { return 1; }\n")
    (folder / "uses.c").write_text("int planted(void);\nint uses(void) { return planted(); }\n")
    library = there / soname
    subprocess.run([*cc, f"-Wl,-soname,{soname}", f"-Wl,--version-script={there}/symbols.map", f"{there}/planted.c", "-o", library], check=True)
    subprocess.run([*cc, folder / "uses.c", library, "-o", folder / made], check=True)
    return folder / made
