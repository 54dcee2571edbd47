#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Gives changed files to the whole program, as a user would.

    python3 tests/campaign/fuzz_program.py --bin build/ci/bin --corpus corpus --seconds 60 --seed 1 [--workers 2]

Each run takes what fuzz_readers --dump makes of its number. It is wrong if it ends by a signal or an undocumented code, does
not print one error line with a code other than 0, takes more than 20 s or 2 GB, leaves a temporary file, or if a result that
was changed is read as if more points were accessible than in the whole one."""
import argparse
import json
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time

CODES = {0, 2, 3, 4, 5, 6, 7}
MEMORY = 2 << 30


def commands(program, reader, folder, file, out, whole):
    """What a user would do with such a file."""
    path = folder / file
    tool = ["--tool", "builtin:pruner", "--voxel", "0.2", "--tau", "2v", "--directions", "8", "--device", "cpu"]
    into = ["--out", out / "map"]
    cloud = ["map", "--scans", path, "--sensor-at", "0,0,1", *tool, *into]
    scans = ["--scans", folder / "scans"]
    table = {
        "pcd": [cloud, ["advise", "--scans", path, "--sensor-at", "0,0,1", "--out", out / "a.toml"]],
        "ply": [cloud], "las": [cloud], "xyz": [cloud], "bin": [cloud],
        "ptx": [["map", "--scans", path, *tool, *into]],
        "rays": [["map", "--scans", path, *tool, *into]],
        "poses": [["map", *scans, "--poses", path, "--allow-disagreement", *tool, *into],
                  ["tile", "plan", out / "plan", *scans, "--poses", path, *tool]],
        "trajectory": [["map", "--scans", folder / "scans.las", "--trajectory", path, *tool, *into]],
        "stations": [["map", *scans, "--stations", path, *tool, *into]],
        "recording": [["map", "--scans", path, *tool, *into], ["info", path]],
        "mesh": [["render", "--tool", path, "--tool-unit", "m", "--out", out / "tool.png"]],
        "orientations": [["map", "--scans", whole / "xyz/plain.xyz/plain.xyz", "--sensor-at", "0,0,1", "--orientations",
                          f"list:{path}", *tool[:2], *tool[2:6], "--device", "cpu", *into]],
        "positions": [["query", "--map", whole / "field/whole", "--points", path]],
        "boxes": [["whatif", whole / "state/state", "--tool", "builtin:pruner", "--segments", path, "--out", out / "whatif"]],
        "segments": [["whatif", whole / "state/state", "--tool", "builtin:pruner", "--segments", path, "--out",
                      out / "whatif"]],
        "state": [["whatif", folder, "--tool", "builtin:pruner", "--remove", "box:1,-1,0,4,1,2", "--out", out / "whatif"]],
        "tiles": [["tile", "status", folder], ["tile", "merge", folder, "--points", out / "all.ply"],
                  ["query", "--map", folder, "--at", "2.2,0.4,1"]],
        "field": [["diff", whole / "field/whole", folder, "--out", out / "diff"], ["query", "--map", folder, "--at", "2.2,0.4,1"],
                  ["report", "--map", folder, "--out", out / "page.html"], ["info", folder / "field.vdb"]],
        "report": [["report", "--map", folder, "--out", out / "page.html"], ["diff", whole / "field/whole", folder, "--out",
                                                                           out / "diff"]],
        "toml": [["map", "--config", path, "--scans", whole / "xyz/plain.xyz/plain.xyz", "--sensor-at", "0,0,1", "--tool",
                  "builtin:pruner", *into]],
    }
    return [[str(word) for word in [program, *command]] for command in table[reader]]


def limited():
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))


def judge(command, out, sanitized):
    """What is wrong with one command, or nothing."""
    try:
        done = subprocess.run(command, capture_output=True, timeout=120 if sanitized else 20,
                              preexec_fn=None if sanitized else limited)
    except subprocess.TimeoutExpired:
        return "took too long"
    text = done.stderr.decode("utf-8", "replace")
    if done.returncode < 0:
        return f"signal {-done.returncode}"
    if "Sanitizer" in text or "runtime error:" in text:
        return "sanitizer: " + next(line for line in text.splitlines() if "Sanitizer" in line or "runtime error:" in line)
    if done.returncode not in CODES:
        return f"undocumented code {done.returncode}"
    errors = [line for line in text.splitlines() if "error[" in line]
    if len(errors) != (0 if done.returncode == 0 else 1):
        return f"{len(errors)} error lines with code {done.returncode}"
    if any("error[internal" in line for line in errors):
        return errors[0]
    left = [p for p in out.rglob("*") if ".tmp" in p.name or p.name.startswith(".")]
    if left:
        return f"left {left[0].name}"
    if command[1] == "diff" and done.returncode == 0 and (out / "diff" / "diff.json").exists():
        opened = json.loads((out / "diff" / "diff.json").read_text())["opened"]
        if opened:
            return f"{opened} points are accessible only in the changed result"
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default="build/ci/bin", type=pathlib.Path)
    parser.add_argument("--corpus", required=True, type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--runs", type=int, default=10 ** 9)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--sanitized", action="store_true", help="the programs are built with sanitizers: no limit on memory")
    options = parser.parse_args()
    options.corpus, options.bin = options.corpus.resolve(), options.bin.resolve()
    end, lock = time.monotonic() + options.seconds, threading.Lock()
    sums = {"next": 0, "runs": 0, "wrong": 0, "accepted": 0}

    def work():
        folder = pathlib.Path(tempfile.mkdtemp(prefix="accessvdb_fuzz_"))
        while time.monotonic() < end:
            with lock:
                number = sums["next"]
                sums["next"] += 1
            if number >= options.runs:
                break
            made = subprocess.run([options.bin / "fuzz_readers", options.corpus, "--seed", str(options.seed), "--only", str(number),
                                   "--dump", folder / "in"], capture_output=True, text=True, check=True).stdout.split()
            all_of = commands(options.bin / "accessvdb", made[0], folder / "in", made[2], folder / "out", options.corpus)
            command = all_of[number // 21 % len(all_of)]
            shutil.rmtree(folder / "out", ignore_errors=True)
            (folder / "out").mkdir()
            wrong = judge(command, folder / "out", options.sanitized)
            with lock:
                sums["runs"] += 1
                if wrong:
                    sums["wrong"] += 1
                    print(f"run {number} of seed {options.seed}: {' '.join(made)}: {command[1]}: {wrong}", flush=True)
        shutil.rmtree(folder, ignore_errors=True)

    threads = [threading.Thread(target=work) for _ in range(options.workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(f"{sums['runs']} runs of the program, {sums['wrong']} wrong")
    return 0 if sums["wrong"] == 0 and sums["runs"] > 0 else 1


if __name__ == "__main__":
    sys.exit(main())
