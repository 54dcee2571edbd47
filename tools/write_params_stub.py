#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Writes the parameters into python/accessvdb/__init__.pyi, after a row of accessvdb/params_rows.h has been added:

    PYTHONPATH=build/ci/python tools/write_params_stub.py

Names and types come from the compiled module, all else in the file stays. python.stub checks that nothing is missing.
"""

import re
from pathlib import Path

import accessvdb

LINE = 120


def type_of(made, name, stub):
    """The stub's type of a setting, and what may be assigned to it."""
    value = getattr(made, name)
    if name == "carry":
        return "Tuple[str, ...]", "Sequence[str]"
    if isinstance(value, tuple):
        return "Tuple[float, float, float]", "_Three"
    if type(value).__module__.startswith("accessvdb"):
        inner = type(value).__name__
        return inner, f"Union[{inner}, Mapping[str, Any]]"
    if not isinstance(value, str):
        return (type(value).__name__,) * 2
    words = ""
    try:
        setattr(made, name, "?")
    except accessvdb.InvalidArgument as error:
        _, _, words = error.problem.partition(" is not one of ")
    if not words:
        return "str", "_Orientations"
    alias = re.search(rf"^(_\w+) = Literal\[{re.escape(words)}\]$", stub, re.MULTILINE)
    if alias is None:
        raise SystemExit(f"{name}: __init__.pyi has no Literal[{words}]")
    return (alias.group(1),) * 2


def attribute(name, got, set_from):
    if got == set_from or got.endswith("Params"):
        return f"    {name}: {got}\n"
    return (
        f"    @property\n    def {name}(self) -> {got}: ...\n"
        f"    @{name}.setter\n    def {name}(self, value: {set_from}) -> None: ...\n"
    )


def settings_of(made, stub):
    """The attributes of one class, and its constructor."""
    names = [name for name, member in vars(type(made)).items() if isinstance(member, property)]
    types = {name: type_of(made, name, stub) for name in names}
    keywords = [f"{name}: {set_from} = ..." for name, (_, set_from) in types.items()]
    init = f"    def __init__(self, *, {', '.join(keywords)}) -> None: ...\n"
    if len(init) > LINE:
        lines = "".join(f"        {keyword},\n" for keyword in ["self", "*", *keywords])
        init = f"    def __init__(\n{lines}    ) -> None: ...\n"
    return "".join(attribute(name, *types[name]) for name in names) + init


def written(stub):
    """The text of the stub with the settings of all classes of parameters."""
    for name in (name for name in accessvdb.__all__ if name.endswith("Params")):
        head = rf'^class {name}\(metaclass=_Compiled\):\n(?:    """.*"""\n\n)?'
        constructor = r"    def __init__\((?:.*|\n(?:        .*\n)*    )\) -> None: \.\.\.\n"
        pattern = rf"({head})(?:    .*\n)*?{constructor}"
        settings = settings_of(getattr(accessvdb, name)(), stub)
        stub, count = re.subn(pattern, lambda found: found.group(1) + settings, stub, flags=re.MULTILINE)
        if count != 1:
            raise SystemExit(f"__init__.pyi has no class {name} with a constructor")
    return stub


if __name__ == "__main__":
    file = Path(__file__).parents[1] / "python/accessvdb/__init__.pyi"
    file.write_text(written(file.read_text()))
