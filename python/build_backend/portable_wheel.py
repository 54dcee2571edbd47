# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Makes the folder of a wheel run on other machines: puts the shared libraries beside the module, under names of their
own, and says by the symbols that all of them need how old a system may be. Needs patchelf and binutils.

A library's name gets a hash of its content, as auditwheel does, so that the loader never takes another wheel's library
of the same name for it. The C and C++ libraries are the system's: a process can have only one of them, and whatever has
glibc 2.35 has these versions of the other two."""

import hashlib
import os
import re
import shutil
import subprocess
from pathlib import Path

LIBRARIES = "accessvdb.libs"  # beside the package
OF_THE_SYSTEM = re.compile(r"(ld-linux.*|libc|libm|libdl|librt|libpthread|libgcc_s|libstdc\+\+)\.so")
# The newest versions of symbols that Ubuntu 22.04 has.
NEWEST = {"GLIBC": (2, 35), "GLIBCXX": (3, 4, 30), "CXXABI": (1, 3, 13), "GCC": (12, 0, 0)}


class NotPortable(Exception):
    """One line: why not, and what to do."""


def output_of(*command):
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"}).stdout
    except FileNotFoundError:
        raise NotPortable(f"'{command[0]}' is missing. On Debian and Ubuntu: apt install patchelf binutils") from None
    except subprocess.CalledProcessError as error:
        raise NotPortable(f"'{command[0]}' failed: {error.stderr.strip()}") from None


def text_of(version):
    return ".".join(map(str, version))


def versions_needed(file):
    """{"GLIBC": (2, 34), ...}: the newest version of each library's symbols that an ELF file needs."""
    newest = {}
    references = output_of("objdump", "-p", file).partition("Version References:")[2]
    for name, numbers in re.findall(r"\b(GLIBC|GLIBCXX|CXXABI|GCC)_(\d+(?:\.\d+)*)\b", references):
        version = tuple(map(int, numbers.split(".")))
        newest[name] = max(newest.get(name, version), version)
    return newest


def platform_tag(files, machine):
    """manylinux_2_35_x86_64: by the newest symbol of glibc. Refuses what a system of NEWEST lacks."""
    glibc = (2, 17)  # the oldest that pip has such a tag for
    for file in files:
        needed = versions_needed(file)
        for name, version in needed.items():
            if version > NEWEST[name]:
                raise NotPortable(
                    f"{Path(file).name} needs {name}_{text_of(version)}, and a wheel may need at most "
                    f"{name}_{text_of(NEWEST[name])}. Build it on Debian 12"
                )
        glibc = max(glibc, needed.get("GLIBC", glibc))
    return f"manylinux_{glibc[0]}_{glibc[1]}_{machine}"


def libraries_of(module):
    """{soname: path} of all shared libraries that a module loads and a system may lack."""
    libraries = {}
    for line in output_of("ldd", module).splitlines():
        soname, arrow, path = line.strip().partition(" => ")
        if path.startswith("not found"):
            raise NotPortable(f"{soname}, which the module needs, is not found. Install its package")
        if arrow and not OF_THE_SYSTEM.match(soname):
            libraries[soname] = Path(path.rpartition(" (")[0])
    return libraries


def bundle(tree, module, machine):
    """Puts the libraries of a module of a wheel's folder beside it.
    Returns the platform's tag and where the libraries came from."""
    libraries = libraries_of(module)
    folder = tree / LIBRARIES
    folder.mkdir()
    names = {}
    for soname, path in libraries.items():
        stem, _, rest = soname.partition(".so")
        names[soname] = f"{stem}-{hashlib.sha256(path.read_bytes()).hexdigest()[:8]}.so{rest}"
        shutil.copyfile(path, folder / names[soname])
    replaced = [word for old, new in names.items() for word in ("--replace-needed", old, new)]
    for name in names.values():
        output_of("strip", "--strip-unneeded", folder / name)
        # One change in one call: patchelf 0.14 mixes up the names of several.
        output_of("patchelf", "--set-soname", name, folder / name)
        if any(old in output_of("patchelf", "--print-needed", folder / name).split() for old in names):
            output_of("patchelf", *replaced, folder / name)
    output_of("patchelf", *replaced, module)
    # DT_RPATH, which holds for what the libraries need, too; DT_RUNPATH would have to be in each, 22 MB more in OpenVDB's.
    path = Path("$ORIGIN", os.path.relpath(folder, module.parent))
    output_of("patchelf", "--force-rpath", "--set-rpath", path, module)
    return platform_tag([module, *folder.iterdir()], machine), list(libraries.values())
