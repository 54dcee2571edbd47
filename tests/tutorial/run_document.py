#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Runs the commands of a document and compares what they print with what it shows.

    run_document.py DOCUMENT BIN WORK

Blocks ```sh run in order, in WORK, where build/release/bin is BIN; folder and PATH go from each to the next. A block ```text
shows what the block before it prints, standard output and errors together:

  ...                             alone on a line: any lines; within a line: anything
  <!-- not run: why -->           before a block ```sh
  <!-- differs: 4 s; 1.9 GiB -->  before a block ```text: the digits in these may be others

A block that shows `error[` has to fail, every other one has to succeed. A picture `images/NAME_X.png` of the document
NAME is what some block wrote as X.png. Shares in per cent and numbers from 1000 on that the text mentions are printed
by some block.
A block whose program is not in BIN is skipped, by name. Exit code 0 or 1.
"""
import re
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

OPTIONAL_PROGRAMS = {"plan"}  # needs a library that a build may lack


class Block:
    def __init__(self, line):
        self.line = line
        self.commands = []
        self.shown = None  # lines, None: nothing
        self.differs = []
        self.not_run = False
        self.printed = []

    def program(self):
        return self.commands[0].split()[0] if self.commands else ""


def blocks_and_text(document):
    """The blocks, the text outside of them, and what is wrong with the document itself."""
    blocks, text, problems = [], [], []
    kind, lines, begin, differs, not_run = None, [], 0, [], False
    for number, line in enumerate(document.splitlines(), 1):
        if kind is None and line.startswith("```"):
            kind, lines, begin = line[3:].strip(), [], number
        elif kind is not None and line == "```":
            if kind == "sh":
                block = Block(begin)
                block.commands, block.not_run = lines, not_run
                blocks.append(block)
            elif kind == "text" and blocks and blocks[-1].shown is None and not blocks[-1].not_run:
                blocks[-1].shown, blocks[-1].differs = lines, differs
                for varying in differs:
                    if not any(varying in shown for shown in lines):
                        problems.append(f"line {begin}: '{varying}' is said to differ and is not shown")
            else:
                problems.append(f"line {begin}: a block '{kind}' that belongs to no command")
            kind, differs, not_run = None, [], False
        elif kind is not None:
            lines.append(line)
        elif match := re.fullmatch(r"<!-- differs: (.*) -->", line):
            differs = match[1].split("; ")
        elif re.fullmatch(r"<!-- not run: .* -->", line):
            not_run = True
        else:
            text.append((number, line))
    if kind is not None:
        problems.append(f"line {begin}: the block does not end")
    return blocks, text, problems


def pattern_of(shown, differs):
    parts = []
    for piece in re.split("(" + "|".join(map(re.escape, ["...", *differs])) + ")", shown):
        if piece == "...":
            parts.append(".*")
        elif piece in differs:
            parts += [r"[\d.]*\d" if n % 2 else re.escape(word) for n, word in enumerate(re.split(r"([\d.]*\d)", piece))]
        else:
            parts.append(re.escape(piece))
    return re.compile("".join(parts))


def mismatch(shown, printed, differs):
    """None, or the first shown line that was not printed in its place."""
    at, free = 0, False
    for line in shown:
        if line == "...":
            free = True
            continue
        pattern = pattern_of(line, differs)
        last = len(printed) if free else min(at + 1, len(printed))
        hit = next((n for n in range(at, last) if pattern.fullmatch(printed[n])), None)
        if hit is None:
            return line
        at, free = hit + 1, False
    return None if free or at == len(printed) else f"nothing after line {at}"


def run(block, work, state, bin_folder):
    script = work / "block.sh"
    script.write_text(
        f". {state}\nset -euo pipefail\n" + "\n".join(block.commands) +
        f"\nset +x; printf 'cd %q; PATH=%q\\n' \"$PWD\" \"$PATH\" >{state}\n")
    # The shell is not interactive, so a program sees that nobody looks at a terminal.
    done = subprocess.run(["bash", script], cwd=work, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, timeout=240)
    block.printed = [line.rstrip() for line in done.stdout.replace("\r", "\n").splitlines()]
    fails = any("error[" in line for line in block.shown or [])
    if (done.returncode != 0) != fails:
        return f"exit code {done.returncode}"
    if block.shown is None:
        return None
    line = mismatch([line.rstrip() for line in block.shown], block.printed, block.differs)
    return None if line is None else f"the document shows\n  {line}"


def pixels(png):
    """What a PNG file holds, whatever version of zlib packed it."""
    at, header, packed = 8, b"", b""
    while at < len(png):
        size = int.from_bytes(png[at:at + 4], "big")
        kind, data = png[at + 4:at + 8], png[at + 8:at + 8 + size]
        header, packed = (data, packed) if kind == b"IHDR" else (header, packed + data if kind == b"IDAT" else packed)
        at += size + 12
    return header + zlib.decompress(packed)


def main():
    document, bin_folder, work = (Path(argument).resolve() for argument in sys.argv[1:])
    shutil.rmtree(work, ignore_errors=True)
    (work / "build/release").mkdir(parents=True)
    (work / "build/release/bin").symlink_to(bin_folder)
    state = work / "state.sh"
    state.write_text("")
    blocks, text, problems = blocks_and_text(document.read_text())

    ran, printed = 0, []
    for block in blocks:
        if block.not_run:
            continue
        if block.program() in OPTIONAL_PROGRAMS and not (bin_folder / block.program()).exists():
            print(f"skipped: line {block.line}: there is no program {block.program()} in {bin_folder}")
            continue
        ran += 1
        problem = run(block, work, state, bin_folder)
        printed += block.printed
        if problem:
            problems.append(f"line {block.line}: {' / '.join(block.commands)}\n{problem}\nand this was printed:\n  " +
                            "\n  ".join(block.printed))
            break  # the others build upon it

    if not problems:
        everything = "\n".join(printed)
        for number, line in text:
            for picture in re.findall(r"\((images/[^)]+\.png)\)", line):
                name = Path(picture).name.removeprefix(document.stem + "_")
                made = [path for path in work.rglob(name) if "build" not in path.relative_to(work).parts]
                files = [*made, document.parent / picture]
                if len(made) != 1 or not files[1].is_file() or pixels(files[0].read_bytes()) != pixels(files[1].read_bytes()):
                    problems.append(f"line {number}: {picture} is not the {name} that the commands make: {made}")
            prose = re.sub(r"`[^`]*`|\]\([^)]*\)", "", line)
            for said in re.findall(r"\d+(?:\.\d+)? %|(?<![\d.])\d{4,}(?![\d.])", prose):
                if said not in everything:
                    problems.append(f"line {number}: '{said}' is printed by no command")
    if ran == 0:
        problems.append("no command ran")
    for problem in problems:
        print(f"{document.name}: {problem}")
    print(f"{ran} blocks ran" + (f", {len(problems)} problems" if problems else ", as the document shows them"))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
