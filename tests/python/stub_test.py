# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The type stubs match the module, both ways: names, members, arguments. mypy accepts them and the example."""

import ast
import enum
import inspect
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import accessvdb

STUB = Path(accessvdb.__file__).with_name("__init__.pyi")
ALLOWLIST = Path(__file__).with_name("stubtest_allowlist.txt")
TREE = ast.parse(STUB.read_text())
OWN = {"__init__", "__len__", "__getitem__", "__iter__", "__copy__", "__deepcopy__"}  # special members that a stub must list


def public(name):
    return not name.startswith("_")


def stub_names():
    names = set()
    for node in TREE.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
            names.add(node.name)
        elif isinstance(node, ast.AnnAssign):
            names.add(node.target.id)
    return {name for name in names if public(name) or name == "__version__"}


def stub_classes():
    return {node.name: node for node in TREE.body if isinstance(node, ast.ClassDef) and public(node.name)}


def stub_members(node):
    members = {}
    for item in node.body:
        if isinstance(item, ast.FunctionDef):
            members.setdefault(item.name, item)
        elif isinstance(item, ast.AnnAssign):
            members[item.target.id] = item
        elif isinstance(item, ast.Assign):
            members[item.targets[0].id] = item
    return members


def arguments(function):
    """Names, where the keyword-only ones begin, and which may be omitted."""
    a = function.args
    names = [arg.arg for arg in a.args + a.kwonlyargs]
    optional = {arg.arg for arg in a.args[len(a.args) - len(a.defaults) :]}
    optional |= {arg.arg for arg, default in zip(a.kwonlyargs, a.kw_defaults) if default is not None}
    return [n for n in names if n != "self"], [arg.arg for arg in a.kwonlyargs], optional - {"self"}


def runtime_arguments(function):
    """The same for a function of the module, from the signature that pybind11 puts at the head of its docstring."""
    head = function.__doc__.splitlines()[0]
    inside = re.search(r"\((.*)\) -> ", head).group(1)
    inside = re.sub(r"\([^()]*\)", "()", inside)  # defaults containing commas
    names, keyword_only, optional = [], [], set()
    star = False
    for part in re.split(r", (?=\*|\w+[:,]|\w+$)", inside):
        if part == "*":
            star = True
            continue
        name = re.match(r"\w+", part).group()
        if name == "self":
            continue
        names.append(name)
        if star:
            keyword_only.append(name)
        if " = " in part:
            optional.add(name)
    return names, keyword_only, optional


class Stub(unittest.TestCase):
    def test_names(self):
        self.assertEqual(stub_names(), set(accessvdb.__all__))
        self.assertEqual({name for name in vars(accessvdb) if public(name)}, set(accessvdb.__all__) - {"__version__"})
        self.assertTrue(STUB.with_name("py.typed").exists())

    def test_members(self):
        for name, node in stub_classes().items():
            made = getattr(accessvdb, name)
            if issubclass(made, enum.IntEnum):
                values = {item.targets[0].id: item.value.value for item in node.body}
                self.assertEqual({member.name: member.value for member in made}, values)
                continue
            members = stub_members(node)
            if issubclass(made, Exception):
                for member in set(members) - {"__init__"}:
                    self.assertTrue(hasattr(made("a", "b", "c", "d"), member), member)
                continue
            here = {member for member in vars(made) if public(member) or member in OWN}
            if "__init__" not in members:
                here.discard("__init__")  # pybind11 adds one to every class, which refuses
                with self.assertRaises(TypeError):
                    made()
            self.assertEqual(here, set(members), name)
            for member, item in members.items():
                is_property = isinstance(inspect.getattr_static(made, member), property)
                decorators = [ast.unparse(d) for d in getattr(item, "decorator_list", [])]
                self.assertEqual(is_property, isinstance(item, ast.AnnAssign) or "property" in decorators, f"{name}.{member}")

    def test_arguments(self):
        compared = 0
        for name, node in stub_classes().items():
            made = getattr(accessvdb, name)
            if issubclass(made, (Exception, enum.IntEnum)):
                continue
            for member, item in stub_members(node).items():
                if not isinstance(item, ast.FunctionDef) or any(ast.unparse(d) == "property" for d in item.decorator_list):
                    continue
                if member in ("__len__", "__iter__", "__copy__", "__deepcopy__"):
                    continue
                if member == "__init__" and name.endswith("Params"):
                    # These take **kwargs; their names are those of the properties.
                    properties = {m for m in vars(made) if isinstance(vars(made)[m], property)}
                    self.assertEqual(set(arguments(item)[0]), properties)
                    continue
                self.assertEqual(arguments(item), runtime_arguments(getattr(made, member)), f"{name}.{member}")
                compared += 1
        for node in TREE.body:
            if isinstance(node, ast.FunctionDef):
                self.assertEqual(arguments(node), runtime_arguments(getattr(accessvdb, node.name)), node.name)
                compared += 1
        self.assertGreater(compared, 15)

    def test_settings_of_the_parameters(self):
        """Their order, types and keywords, too, are those of the module."""
        sys.path.insert(0, os.environ["SOURCE"] + "/tools")
        import write_params_stub

        text = STUB.read_text()
        self.assertEqual(write_params_stub.written(text), text, "run tools/write_params_stub.py")
        without = text.replace("    range_noise_m: float\n", "", 1)
        self.assertNotEqual(without, text)
        self.assertEqual(write_params_stub.written(without), text)

    def test_everything_has_a_docstring(self):
        for name in accessvdb.__all__:
            thing = getattr(accessvdb, name)
            if isinstance(thing, type) or callable(thing):
                self.assertTrue(thing.__doc__, name)

    def test_stubtest(self):
        """mypy.stubtest finds what is planted, and nothing else. It does not read pybind11's signatures; test_arguments does."""
        if sys.prefix != "/usr":
            self.skipTest("mypy is the distribution's, and this Python is not")
        with tempfile.TemporaryDirectory() as folder:
            package = Path(folder, "accessvdb")
            shutil.copytree(STUB.parent, package, ignore=shutil.ignore_patterns("__pycache__", "_accessvdb*"))
            (compiled,) = STUB.parent.glob("_accessvdb.*.so")
            (package / compiled.name).symlink_to(compiled)
            stub = package / STUB.name
            stub.write_text(stub.read_text().replace("    def grown_by(", "    def shrunk_by(self) -> None: ...\n    def grown_by("))
            ran = subprocess.run(
                [sys.executable, "-m", "mypy.stubtest", "accessvdb", "--concise", "--allowlist", ALLOWLIST],
                env={**os.environ, "PYTHONPATH": folder, "MYPYPATH": folder},
                cwd=folder,  # mypy keeps a cache where it runs
                capture_output=True,
                text=True,
            )
        self.assertNotIn("No module named mypy", ran.stderr, "mypy is missing; on Debian and Ubuntu: apt install mypy")
        self.assertEqual((ran.returncode, ran.stdout), (1, "accessvdb.ToolGeometry.shrunk_by is not present at runtime\n"), ran.stderr)

    def test_mypy(self):
        source = Path(os.environ["SOURCE"])
        with tempfile.TemporaryDirectory() as folder:
            wrong = Path(folder, "wrong.py")
            wrong.write_text(
                "import accessvdb\n"
                'field = accessvdb.AccessibilityField("builtin:pencil")\n'
                'accessvdb.TsdfParams(region="cone")\n'
                "field.snapshot().labels\n"
            )
            mypy = shutil.which("mypy", path="/usr/bin" + os.pathsep + os.environ["PATH"])
            self.assertIsNotNone(mypy, "mypy is missing; on Debian and Ubuntu: apt install mypy")
            os.environ["MYPYPATH"] = str(STUB.parents[1])
            command = [mypy, "--strict", "--cache-dir", folder]
            good = subprocess.run(
                [
                    *command,
                    str(STUB),
                    *(str(source / "examples/python" / name) for name in ("map_a_corner.py", "rolling.py")),
                    str(STUB.with_name("tiles.py")),
                ],
                capture_output=True,
                text=True,
            )
            self.assertEqual(good.returncode, 0, good.stdout + good.stderr)
            bad = subprocess.run([*command, str(wrong)], capture_output=True, text=True)
            self.assertEqual([line.split(":")[1] for line in bad.stdout.splitlines()[:-1] if ": error:" in line], ["2", "3", "4"])


if __name__ == "__main__":
    unittest.main()
