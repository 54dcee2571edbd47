#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Shows that run_document.py and run_notebook.py fail where a document and its commands differ, and only there."""
import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
COUNT = "```sh\nseq 3; echo done in 1.5 s\n```\n"
RIGHT = COUNT + "<!-- differs: 7 s -->\n```text\n1\n2\n3\ndone in 7 s\n```\n"
MESSAGE = "```sh\necho 'error[x.y] wrong' >&2; exit 3\n```\n```text\nerror[x.y] ...\n```\n"

DOCUMENTS = [  # what the runner has to say: 0 or 1, a part of its words, the document
    (0, "1 blocks ran", RIGHT),
    (1, "shows\n  4", RIGHT.replace("\n3\n", "\n4\n")),
    (1, "shows\n  done in 7 s", RIGHT.replace("<!-- differs: 7 s -->\n", "")),
    (1, "is not shown", RIGHT.replace("differs: 7", "differs: 8")),
    (1, "shows\n  2", RIGHT.replace("\n2\n", "\n").replace("```text\n1", "```text\n2\n1")),
    (1, "shows\n  3", RIGHT.replace("\n2\n", "\n")),
    (0, "1 blocks ran", RIGHT.replace("\n2\n", "\n...\n")),
    (1, "nothing after line 2", COUNT + "```text\n1\n2\n```\n"),
    (0, "1 blocks ran", COUNT + "```text\n1\n...\n```\n"),
    (0, "1 blocks ran", COUNT),
    (0, "1 blocks ran", MESSAGE),
    (1, "exit code 0", MESSAGE.replace("; exit 3", "")),
    (1, "exit code 3", MESSAGE.replace("error[x.y]", "")),
    (1, "exit code 1", "```sh\nfalse\ntrue\n```\n"),
    (1, "exit code 127", "```sh\nno_such_program\n```\n"),
    (1, "no command ran", "<!-- not run: builds -->\n```sh\nfalse\n```\n"),
    (0, "1 blocks ran", "<!-- not run: builds -->\n```sh\nfalse\n```\n" + COUNT),
    (1, "belongs to no command", "```text\n1\n```\n" + COUNT),
    (1, "belongs to no command", COUNT + "```\n1\n```\n"),
    (1, "does not end", COUNT + "```sh\nseq 3\n"),
    (0, "2 blocks ran", "```sh\nmkdir a; cd a; PATH=$PWD:$PATH\n```\n```sh\n[[ ${PWD##*/} == a && $PATH == $PWD:* ]]\n```\n"),
    (0, "1 blocks ran", "```sh\n[[ $(readlink build/release/bin) == BIN ]]\n```\n"),
    (0, "no program plan", COUNT + "```sh\nplan --map state\n```\n```text\n1\n```\n"),
    (0, "1 blocks ran", "Of 1234 it is 5.5 %, `99 %`.\n```sh\necho 1234 5.5 %\n```\n"),
    (1, "'5.6 %' is printed by no", "Of 1234 it is 5.6 %.\n```sh\necho 1234 5.5 %\n```\n"),
    (1, "'1235' is printed by no", "Of 1235 it is 5.5 %.\n```sh\necho 1234 5.5 %\n```\n"),
    (0, "1 blocks ran", "![a](images/a_b.png)\n```sh\ncp ORIGINAL b.png\n```\n"),
    (1, "is not the b.png", "![a](images/a_b.png)\n```sh\ncp OTHER b.png\n```\n"),
    (1, "is not the b.png", "![a](images/a_b.png)\n" + COUNT),
    (1, "is not the c.png", "![a](images/a_c.png)\n```sh\ncp ORIGINAL c.png\n```\n"),
]

CELL = "print('a', 1)\nprint('b')"
CELLS = [  # the same for a notebook: of cells with source and shown output
    (0, "2 cells ran", [(CELL, "a 1\nb\n"), ("x = 1", "")]),
    (1, "cell 0", [(CELL, "a 2\nb\n")]),
    (1, "cell 1", [("x = 1", ""), (CELL, "")]),
    (1, "cell 0", [("x = 1", "1\n")]),
    (0, "2 cells ran", [("x = 1", ""), ("print(x)", "1\n")]),
    (1, "ZeroDivisionError", [("1 / 0", "")]),
    (1, "no cell", []),
]


def png(colour):
    import zlib
    chunks = b"".join(len(data).to_bytes(4, "big") + kind + data + bytes(4) for kind, data in [
        (b"IHDR", bytes([0, 0, 0, 1, 0, 0, 0, 1, 8, 0, 0, 0, 0])), (b"IDAT", zlib.compress(bytes([0, colour]))), (b"IEND", b"")])
    return b"\x89PNG\r\n\x1a\n" + chunks


def expect(code, words, arguments, what):
    done = subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != code or words not in done.stdout + done.stderr:
        sys.exit(f"FAILED: exit code {done.returncode} instead of {code}, or no '{words}', for\n{what}\n{done.stdout}{done.stderr}")


def main():
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder).resolve()
        for name in ("bin", "docs/images", "modules"):
            (root / name).mkdir(parents=True)
        (root / "docs/images/a_b.png").write_bytes(png(1))
        (root / "other.png").write_bytes(png(2))
        for code, words, text in DOCUMENTS:
            text = text.replace("BIN", str(root / "bin")).replace("ORIGINAL", str(root / "docs/images/a_b.png"))
            document = root / "docs" / "a.md"
            document.write_text(text.replace("OTHER", str(root / "other.png")))
            expect(code, words, [HERE / "run_document.py", document, root / "bin", root / "work"], text)

        notebook = root / "docs/a.ipynb"
        for code, words, cells in CELLS:
            notebook.write_text(json.dumps({
                "nbformat": 4, "nbformat_minor": 5, "metadata": {},
                "cells": [{"id": f"c{n}", "cell_type": "code", "metadata": {}, "execution_count": None, "source": source,
                           "outputs": [{"output_type": "stream", "name": "stdout", "text": shown}] if shown else []}
                          for n, (source, shown) in enumerate(cells)]}))
            expect(code, words, [HERE / "run_notebook.py", notebook, root / "bin", root / "work", "json"], cells)
        expect(77, "skipped: ", [HERE / "run_notebook.py", notebook, root / "bin", root / "work", "no_such_package.module"], "no module")
    print("every rule fires")


if __name__ == "__main__":
    main()
