#!/usr/bin/python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""What Dask costs per tile: two plain processes (xargs -P2) against accessvdb.tiles with two workers on loopback.

    tests/bench/tiles_dask_bench.py --program build/ci/bin/accessvdb --scans SCANS --poses POSES --tiles 6.4 [--rounds 3]

Prints one JSON object: the seconds of each round, the ratio of the shortest ones (plain / Dask), and per tile the time that a
slot waited for the engine between two processes. Workers and scheduler run before the clock starts; bin and merge are not
counted, the driver's own start is. Needs python3-distributed.
"""

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def plain(program, out):
    """Seconds of two processes that xargs keeps busy."""
    begin = time.monotonic()
    names = subprocess.check_output([program, "tile", "list", out, "--todo"])
    command = ["xargs", "-P2", "-n1", program, "tile", "run", out, "--threads", "1", "--device", "cpu", "--tile"]
    subprocess.run(command, input=names, check=True, **QUIET)
    return time.monotonic() - begin


def dask(address, program, out):
    """The same by the driver, and what it says at the end."""
    environment = dict(os.environ, PYTHONPATH=str(SOURCE / "python"), ACCESSVDB_PROGRAM=program)
    command = [sys.executable, "-m", "accessvdb.tiles", "run", out, "--scheduler", address, "--threads-per-worker", "1"]
    begin = time.monotonic()
    driver = subprocess.Popen([*command, "--device", "cpu", "--keep-rays"], env=environment, stderr=subprocess.PIPE, text=True)
    seconds, words = 0.0, ""
    for line in driver.stderr:
        if " mapped " in line:
            seconds, words = time.monotonic() - begin, line.strip()
    if driver.wait() != 0 or not words:
        sys.exit("the driver failed")
    return seconds, words


def cluster(folder, program):
    """A scheduler and two workers; their processes and the scheduler's address."""
    file = Path(folder, "scheduler.json")
    environment = dict(os.environ, ACCESSVDB_PROGRAM=program)
    common = {"env": environment, "cwd": folder, **QUIET}
    more = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", "--scheduler-file", str(file)]
    processes = [subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", *more], **common)]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--no-nanny", "--nthreads", "1", *more]
    processes += [subprocess.Popen(worker, **common) for _ in range(2)]
    while not file.exists():
        if processes[0].poll() is not None:
            sys.exit("Dask's scheduler does not start; on Debian and Ubuntu: apt install python3-distributed")
        time.sleep(0.1)
    time.sleep(3)
    return processes, json.loads(file.read_text())["address"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("program", "scans", "poses"):
        parser.add_argument(f"--{name}", required=True, type=os.path.abspath)
    parser.add_argument("--tool", default="builtin:pruner")
    parser.add_argument("--voxel", default="0.05")
    parser.add_argument("--tiles", required=True)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # ends the cluster too
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder, "out"))
        common = ["--scans", options.scans, "--poses", options.poses, "--tool", options.tool, "--voxel", options.voxel]
        subprocess.run([options.program, "tile", "plan", out, *common, "--tiles", options.tiles], check=True, **QUIET)
        subprocess.run([options.program, "tile", "bin", out], check=True, **QUIET)
        processes, address = cluster(folder, options.program)
        times = {"plain": [], "dask": []}
        try:
            for _ in range(options.rounds):
                shutil.rmtree(Path(out, "tiles"), ignore_errors=True)
                times["plain"].append(plain(options.program, out))
                shutil.rmtree(Path(out, "tiles"))
                seconds, words = dask(address, options.program, out)
                times["dask"].append(seconds)
        finally:
            for process in processes:
                process.kill()
        engine = float(re.search(r"([0-9.]+) s waiting for the engine", words).group(1))
        shortest = {name: min(values) for name, values in times.items()}
        result = {
            "tiles": int(re.search(r"mapped (\d+) tiles", words).group(1)),
            "seconds": {name: [round(value, 2) for value in values] for name, values in times.items()},
            "plain_over_dask": round(shortest["plain"] / shortest["dask"], 3),
            "engine_s_per_tile": engine,
            "last_round": words,
        }
        print(json.dumps(result, indent=2))


main()
