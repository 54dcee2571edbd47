#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Runs the code cells of a notebook in order, without Jupyter, and compares what they print with the outputs in it.

    run_notebook.py NOTEBOOK BIN WORK [MODULE]      exit code 0, 1, or 77 where MODULE (the compiled one) is not there
    run_notebook.py --write NOTEBOOK BIN WORK       puts what is printed into the notebook

Cells run in WORK/docs, as in a source tree whose build/release/bin is BIN.
"""
import contextlib
import importlib.util
import io
import json
import os
import shutil
import sys
import traceback
import warnings
from pathlib import Path


def is_there(module):
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # nor its package
        return False


def shown_by(cell):
    return "".join("".join(output.get("text", "")) for output in cell["outputs"])


def main():
    arguments = sys.argv[1:]
    write = arguments[0] == "--write"
    notebook, bin_folder, work = (Path(argument).resolve() for argument in arguments[write:][:3])
    module = (arguments[write:][3:] or ["accessvdb._accessvdb"])[0]
    if not is_there(module):
        print(f"skipped: {notebook.name}: there is no Python module {module}")
        return 77
    content = json.loads(notebook.read_text())
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    ids = [cell["id"] for cell in content["cells"]]
    if content["nbformat"] != 4 or not cells or len(set(ids)) != len(ids):
        print(f"{notebook.name}: no cell to run, ids that are not unique, or not nbformat 4")
        return 1

    shutil.rmtree(work, ignore_errors=True)
    (work / "build/release").mkdir(parents=True)
    (work / "build/release/bin").symlink_to(bin_folder)
    (work / "docs").mkdir()
    os.chdir(work / "docs")
    warnings.simplefilter("error")
    names = {"__name__": "__main__"}
    for number, cell in enumerate(cells):
        source, printed = "".join(cell["source"]), io.StringIO()
        try:
            with contextlib.redirect_stdout(printed):
                exec(compile(source, f"cell {number}", "exec"), names)
        except Exception:
            print(f"{notebook.name}: cell {number}:\n{source}\n{traceback.format_exc()}")
            return 1
        if write:
            text = printed.getvalue().splitlines(keepends=True)
            cell["outputs"] = [{"name": "stdout", "output_type": "stream", "text": text}] if text else []
        elif printed.getvalue() != shown_by(cell):
            print(f"{notebook.name}: cell {number} shows\n{shown_by(cell)}\nand prints\n{printed.getvalue()}")
            return 1
    if write:
        notebook.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    print(f"{len(cells)} cells ran")
    return 0


if __name__ == "__main__":
    sys.exit(main())
