#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Maps the tiles of a planned folder by plain processes, `accessvdb tile run --worker`, for benchmarks on bare machines.

    run_tiles_plainly.py PROGRAM FOLDER --gpus 0,1 --per-gpu 8 --threads 2

Each process keeps its GPU and takes tile after tile, those with most returns first. Prints the seconds from before the
first process begins to after the last tile, and how many tiles there were. Stops with code 1 when a process does.
"""

import argparse
import os
import queue
import subprocess
import sys
import threading
import time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder")
    parser.add_argument("--gpus", default="0", help="their numbers, with commas")
    parser.add_argument("--per-gpu", type=int, default=8, help="processes")
    parser.add_argument("--threads", type=int, default=2, help="of each process")
    options = parser.parse_args()
    names: "queue.SimpleQueue[str]" = queue.SimpleQueue()
    tiles = subprocess.check_output([options.program, "tile", "list", options.folder, "--todo"], text=True).split()
    for name in tiles:
        names.put(name)
    failed = []

    def serve(gpu: str) -> None:
        command = [options.program, "tile", "run", options.folder, "--worker", "--threads", str(options.threads)]
        process = subprocess.Popen(
            command,
            env=dict(os.environ, CUDA_VISIBLE_DEVICES=gpu),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert process.stdin is not None and process.stdout is not None
        while not names.empty():
            try:
                name = names.get_nowait()
            except queue.Empty:  # another process was faster
                break
            try:
                print(name, file=process.stdin, flush=True)
            except OSError:
                pass  # it has ended; what it has not printed was not mapped
            if process.stdout.readline().strip() != name:
                failed.append(name)
                break
        process.stdin.close()
        process.wait()

    begin = time.monotonic()
    gpus = options.gpus.split(",")
    threads = [threading.Thread(target=serve, args=(gpus[n % len(gpus)],)) for n in range(options.per_gpu * len(gpus))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failed:
        sys.exit("run_tiles_plainly: error: not mapped: " + ", ".join(failed))
    print(f"{time.monotonic() - begin:.1f} s, {len(tiles)} tiles")


if __name__ == "__main__":
    main()
