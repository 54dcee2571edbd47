#!/usr/bin/env -S /usr/bin/python3 -I -S
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Stands in for the program `accessvdb` in tests of accessvdb.tiles: its tiles end as OUT/script.json says.

script.json: {"tile": ["what the first attempt does", "the second", ...]}; the last one is repeated. OUT/log gets a line
per call. With OUT/slow_bin the step before the tiles takes long.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path


def log(out, entry):
    with open(out / "log", "a") as file:
        file.write(json.dumps(entry) + "\n")


def fail(code, id, subject="subject", problem="problem"):
    error = {"level": "error", "id": id, "exit_code": code, "subject": subject, "problem": problem, "advice": "Advice"}
    print(json.dumps(error), file=sys.stderr)
    sys.exit(code)


def manifest(out, tile):
    return out / "tiles" / tile / "tile.json"


def todo(out):
    left = []

    def add(tile):
        if manifest(out, tile).exists():
            return
        if (out / "tiles" / f"{tile}.split.json").exists():
            for digit in "0123":
                add((tile if "." in tile else tile + ".") + digit)
        else:
            left.append(tile)

    for tile in json.loads((out / "script.json").read_text()):
        if "." not in tile:
            add(tile)
    return left


def finish(out, tile):
    whole, _, digits = tile.partition(".")
    for level in range(len(digits)):
        (out / "tiles").mkdir(exist_ok=True)
        parent = whole + ("." + digits[:level] if level else "")
        (out / "tiles" / f"{parent}.split.json").write_text("{}")
    manifest(out, tile).parent.mkdir(parents=True, exist_ok=True)
    manifest(out, tile).write_text(json.dumps({"tile": tile, "points": 3, "returns": 5, "seconds": 0.0}))


def run(out, arguments):
    assert "--worker" in arguments, arguments
    for line in iter(sys.stdin.readline, ""):
        run_tile(out, line.strip(), arguments)
        print(line.strip(), flush=True)


def run_tile(out, tile, arguments):
    folder = out / "attempts" / tile
    folder.mkdir(parents=True, exist_ok=True)
    attempt = len(list(folder.iterdir()))
    (folder / str(attempt)).touch()
    gpu = os.environ.get("CUDA_VISIBLE_DEVICES")
    log(out, {"step": "run", "tile": tile, "pid": os.getpid(), "gpu": gpu, "at": time.time(), "arguments": arguments})
    steps = json.loads((out / "script.json").read_text()).get(tile, ["ok"])
    word, *values = steps[min(attempt, len(steps) - 1)].split()
    if word == "exit":
        sys.exit(int(values[0]))
    if word == "error":
        fail(int(values[0]), values[1], f"tile {tile}")
    if word == "kill":
        os.kill(os.getpid(), int(values[0]))
    if word == "grow":  # to so many MiB, then as the kernel does it
        kept = bytearray(b"x") * (int(values[0]) << 20)
        time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGKILL if kept else 0)
    if word == "wait":  # for the end of standard input
        sys.stdin.buffer.read()
        log(out, {"step": "stopped", "tile": tile})
        sys.exit(143)
    if word == "beside":  # until so many have started, and a little longer, in case there are more
        end = time.monotonic() + 20
        while (out / "log").read_text().count('"step": "run"') < int(values[0]) and time.monotonic() < end:
            time.sleep(0.02)
        time.sleep(0.2)
    if word == "sleep":
        time.sleep(float(values[0]))
    if word == "nothing":
        sys.exit(0)
    finish(out, tile)
    log(out, {"step": "end", "tile": tile, "gpu": gpu, "at": time.time()})
    if word == "leave":  # as one that has waited too long, just when it is given its next tile
        print(tile, flush=True)
        sys.exit(0)


def main():
    step, out, *arguments = sys.argv[2:]
    out = Path(out)
    if step == "run":
        return run(out, arguments)
    log(out, {"step": step, "pid": os.getpid(), "arguments": arguments})
    if step == "list":
        if not (out / "rays.json").exists():
            fail(3, "rays.missing")
        print("\n".join(todo(out)))
    elif step == "bin":
        time.sleep(60 if (out / "slow_bin").exists() else 0)
        (out / "rays.json").write_text("{}")
    elif step == "merge" and todo(out) and "--partial" not in arguments:
        fail(4, "tile.unfinished")


main()
