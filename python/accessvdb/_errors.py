# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The exceptions of accessvdb: one base class, one subclass per kind of failure."""

import platform
import re
import sys
from pathlib import Path


class Error(Exception):
    """Anything that went wrong in accessvdb. str() is one line: what is wrong, and what to do."""

    code = 70  # the exit code of the program for this kind

    def __init__(self, id: str, subject: str, problem: str, advice: str = "") -> None:
        super().__init__(id, subject, problem, advice)  # so that it can be pickled
        self.id = id  # stable dotted name, for example "input.truncated"
        self.subject = subject  # the file, argument or device that it is about; may be empty
        self.problem = problem
        self.advice = advice

    def __str__(self) -> str:
        text = f"{self.subject}: {self.problem}." if self.subject else f"{self.problem}."
        return f"{text} {self.advice}." if self.advice else text


class InvalidArgument(Error, ValueError):
    """An argument or parameter is wrong; nothing has changed."""

    code = 2


class InputError(Error):
    """An input cannot be read or is malformed."""

    code = 3


class UnusableInput(Error):
    """An input is well formed but cannot be used: a pose that is not rigid, a tool of 100 m."""

    code = 4


class ResourceLimit(Error, MemoryError):
    """Memory or another limit would be exceeded."""

    code = 5


class DeviceError(Error):
    """The requested device is missing or lost."""

    code = 6


class OutputError(Error):
    """An output cannot be written durably."""

    code = 7


class InternalError(Error):
    """A bug in accessvdb."""

    code = 70


ALL = (Error, InvalidArgument, InputError, UnusableInput, ResourceLimit, DeviceError, OutputError, InternalError)
for _class in ALL:
    _class.__module__ = "accessvdb"


def import_error(error: ImportError, package: str) -> ImportError:
    """What the loader said of the compiled module, in one line that says what to do.

    package: the __file__ of the package"""
    build = "build it here: docs/python.md of the sources"
    lacks = re.search(r"version [`']((?:GLIBC|GLIBCXX|CXXABI)_[0-9.]+)' not found", str(error))
    if lacks:
        return ImportError(
            f"accessvdb: this system is too old for this module: it has glibc {platform.libc_ver()[1]} and lacks {lacks[1]}. "
            f"Use Debian 12, Ubuntu 22.04 or newer, or {build}.",
            name=error.name,
            path=error.path,
        )
    others = sorted(Path(package).parent.glob("_accessvdb.*.so"))
    if isinstance(error, ModuleNotFoundError) and error.name == "accessvdb._accessvdb" and others:
        return ModuleNotFoundError(
            f"accessvdb: {others[0].name} is for another Python; this is {sys.implementation.cache_tag} on "
            f"{platform.machine()}. Install the wheel for it, or {build}.",
            name=error.name,
        )
    return error
