#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Runs the code cells of a notebook in order, without Jupyter, and compares what they print with the outputs in it. With
matplotlib each cell draws as many figures as the notebook shows behind it.

    run_notebook.py NOTEBOOK BIN WORK [MODULE]      exit code 0, 1, or 77 where MODULE (the compiled one) is not there
    run_notebook.py --write NOTEBOOK BIN WORK       puts what is printed and drawn into the notebook

Cells run in WORK/docs, as in a source tree whose build/release/bin is BIN. Then notebook_figures.py
says what is wrong with the figures.
"""
import base64
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

import notebook_figures


def is_there(module):
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # nor its package
        return False


def new_figures():
    """Those of this cell: Jupyter, too, shows and closes them after it."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is None:
        return []
    figures = [pyplot.figure(number) for number in pyplot.get_fignums()]
    pyplot.close("all")
    return figures


def output_of(figure):
    png = io.BytesIO()
    figure.savefig(png, dpi=72, bbox_inches="tight", metadata={"Software": None})
    return {
        "data": {"image/png": base64.b64encode(png.getvalue()).decode() + "\n", "text/plain": [repr(figure)]},
        "metadata": {},
        "output_type": "display_data",
    }


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
    os.environ["MPLBACKEND"] = "Agg"  # draws into memory
    warnings.simplefilter("error")
    with_figures = is_there("matplotlib")
    names, drawn = {"__name__": "__main__"}, 0
    for number, cell in enumerate(cells):
        source, printed = "".join(cell["source"]), io.StringIO()
        try:
            with contextlib.redirect_stdout(printed):
                exec(compile(source, f"cell {number}", "exec"), names)
        except Exception:
            print(f"{notebook.name}: cell {number}:\n{source}\n{traceback.format_exc()}")
            return 1
        figures = new_figures()
        drawn += len(figures)
        if write:
            text = printed.getvalue().splitlines(keepends=True)
            cell["outputs"] = [{"name": "stdout", "output_type": "stream", "text": text}] if text else []
            cell["outputs"] += map(output_of, figures)
        elif with_figures and len(figures) != sum("image/png" in o.get("data", ()) for o in cell["outputs"]):
            print(f"{notebook.name}: cell {number} shows another number of figures than {len(figures)}, which it draws")
            return 1
        elif printed.getvalue() != shown_by(cell):
            print(f"{notebook.name}: cell {number} shows\n{shown_by(cell)}\nand prints\n{printed.getvalue()}")
            return 1
    if write:
        notebook.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    wrong = notebook_figures.wrong_in(names) if drawn else []
    print("\n".join(wrong) or f"{len(cells)} cells ran" + ("" if with_figures else ", without figures: no matplotlib"))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
