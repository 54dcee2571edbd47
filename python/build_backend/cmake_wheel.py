# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""PEP 517 back end for `pip install .`: configures and builds with CMake and packs the result. Standard library only.

The build folder is build/python-TAG in the source tree, so a second install compiles only what changed; every run
configures it again, so no earlier setting persists. Settings, with pip's --config-settings or the environment:
  build-dir=DIR   ACCESSVDB_BUILD_DIR   another build folder
  cmake-args=...  CMAKE_ARGS            more arguments for CMake, as on a command line: "-DACCESSVDB_CUDA=OFF"
  portable=ON     ACCESSVDB_PORTABLE    a wheel for other machines, with all libraries and licences in it, without a GPU
"""

import base64
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from pathlib import Path

import portable_wheel

ROOT = Path(__file__).resolve().parents[2]
NAME = "accessvdb"
LICENCE = ROOT / "LICENSE"
# Contents of a source archive: everything that the module is built from.
SOURCES = ["CHANGELOG.md", "CMakeLists.txt", "LICENSE", "README.md", "cmake", "include",
           "nanovdb_kernels", "pyproject.toml", "python", "src", "docs/licences.md", "tools/collect_licences.sh", "tools/setup_debian.sh"]  # fmt: skip
BYTES_PER_JOB = 2 << 30  # a translation unit with OpenVDB takes up to this much


def fail(message):
    sys.exit(f"accessvdb: error: {message}")


def version():
    found = re.search(r"^project\(AccessVDB VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text(), re.MULTILINE)
    return found.group(1) if found else fail("CMakeLists.txt names no version.")


def setting(settings, name, variable):
    return (settings or {}).get(name) or os.environ.get(variable) or ""


def is_portable(settings):
    return setting(settings, "portable", "ACCESSVDB_PORTABLE").upper() in ("ON", "1", "YES", "TRUE")


def wheel_tag(platform=None):
    """cp311-cp311-linux_x86_64: this interpreter, on this machine; the libraries are the distribution's."""
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    return f"{python}-{python}-{platform or re.sub('[-.]', '_', sysconfig.get_platform())}"


def metadata():
    project = (ROOT / "pyproject.toml").read_text()
    summary = re.search(r'^description = "(.*)"$', project, re.MULTILINE).group(1)
    needs = re.search(r'^requires-python = "(.*)"$', project, re.MULTILINE).group(1)
    header = [
        "Metadata-Version: 2.1",
        f"Name: {NAME}",
        f"Version: {version()}",
        f"Summary: {summary}",
        "License: Apache-2.0",
        f"Requires-Python: {needs}",
        "Requires-Dist: numpy",
        "Description-Content-Type: text/markdown",
    ]
    return "\n".join(header) + "\n\n" + (ROOT / "README.md").read_text(encoding="utf-8")


def write_dist_info(folder, tag):
    """Everything but RECORD, which is added with the wheel."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "METADATA").write_text(metadata(), encoding="utf-8")
    (folder / "WHEEL").write_text(
        f"Wheel-Version: 1.0\nGenerator: accessvdb {version()}\nRoot-Is-Purelib: false\nTag: {tag}\n"
    )
    shutil.copy(LICENCE, folder / "LICENSE")


def run(*command):
    print("+", shlex.join(map(str, command)), flush=True)
    try:
        subprocess.run(command, check=True)
    except FileNotFoundError:
        fail(f"'{command[0]}' is missing. On Debian and Ubuntu: ./tools/setup_debian.sh --python")
    except subprocess.CalledProcessError as error:
        fail(f"'{command[0]}' failed with code {error.returncode}; see its message above.")


def jobs():
    try:
        pages = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // BYTES_PER_JOB
    except (ValueError, OSError):
        pages = 1
    return max(1, min(pages, len(os.sched_getaffinity(0))))


def build(prefix, settings):
    """Returns the build folder; what was built is below prefix."""
    folder = Path(setting(settings, "build-dir", "ACCESSVDB_BUILD_DIR") or ROOT / "build" / f"python-{wheel_tag()}")
    more = shlex.split(setting(settings, "cmake-args", "CMAKE_ARGS"))
    options = {
        "CMAKE_BUILD_TYPE": "Release",
        "CMAKE_CXX_COMPILER_LAUNCHER": shutil.which("ccache") or "",
        "Python3_EXECUTABLE": sys.executable,
        "ACCESSVDB_PYTHON": "ON",
        "ACCESSVDB_BOTH_KINDS": "OFF",
        "ACCESSVDB_BUILD_TOOLS": "OFF",
        "ACCESSVDB_BUILD_EXAMPLES": "OFF",
        "ACCESSVDB_BUILD_TESTS": "OFF",
        "ACCESSVDB_BUILD_BENCHMARKS": "OFF",
        "ACCESSVDB_INSTALL": "OFF",
        "ACCESSVDB_CUDA": "OFF" if is_portable(settings) else "AUTO",
    }
    os.environ.setdefault("CCACHE_BASEDIR", str(ROOT))
    generator = ["-G", "Ninja"] if shutil.which("ninja") else []
    given = [f"-D{name}={value}" for name, value in options.items()]
    run("cmake", "--fresh", "-S", str(ROOT), "-B", str(folder), *generator, *given, *more)
    run("cmake", "--build", str(folder), "--target", "accessvdb_python", "-j", str(jobs()))
    run("cmake", "--install", str(folder), "--component", "python", "--prefix", str(prefix), "--strip")
    return folder


def make_portable(tree, dist_info, build_folder):
    """Adds the libraries and licences. Returns the platform's tag."""
    (module,) = (tree / NAME).glob("_accessvdb.*.so")
    try:
        platform, libraries = portable_wheel.bundle(tree, module, os.uname().machine)
    except portable_wheel.NotPortable as error:
        fail(error)
    headers = ["--headers-of", str(build_folder)] if (build_folder / "build.ninja").exists() else []
    run(str(ROOT / "tools/collect_licences.sh"), str(dist_info / "licences"), *headers, *map(str, libraries))
    return platform


def record_line(path, data):
    digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
    return f"{path},sha256={digest},{len(data)}\n"


def pack_wheel(tree, wheel):
    """Packs a whole folder, with the list of files and hashes that the format requires."""
    record_name = f"{NAME}-{version()}.dist-info/RECORD"
    record = ""
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in tree.rglob("*") if p.is_file()):
            name, data = path.relative_to(tree).as_posix(), path.read_bytes()
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # the same bytes for the same content
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if ".so" in path.suffixes else 0o644) << 16
            archive.writestr(entry, data)
            record += record_line(name, data)
        archive.writestr(zipfile.ZipInfo(record_name, (1980, 1, 1, 0, 0, 0)), record + f"{record_name},,\n")


# ---- the calls of PEP 517 ---------------------------------------------------------------------------------------------


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    name = f"{NAME}-{version()}.dist-info"
    write_dist_info(Path(metadata_directory) / name, wheel_tag())
    return name


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        dist_info = tree / f"{NAME}-{version()}.dist-info"
        build_folder = build(tree, config_settings or {})
        platform = make_portable(tree, dist_info, build_folder) if is_portable(config_settings) else None
        write_dist_info(dist_info, wheel_tag(platform))
        name = f"{NAME}-{version()}-{wheel_tag(platform)}.whl"
        pack_wheel(tree, Path(wheel_directory) / name)
    return name


def build_sdist(sdist_directory, config_settings=None):
    top = f"{NAME}-{version()}"
    with tarfile.open(Path(sdist_directory) / f"{top}.tar.gz", "w:gz", format=tarfile.PAX_FORMAT) as archive:
        for name in SOURCES:
            archive.add(ROOT / name, f"{top}/{name}", filter=lambda e: None if "__pycache__" in e.name else e)
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "PKG-INFO").write_text(metadata(), encoding="utf-8")
            archive.add(Path(folder) / "PKG-INFO", f"{top}/PKG-INFO")
    return f"{top}.tar.gz"
