#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Runs `live` or `map --update-every 1` on a closed path for as long as you like: after the first lap nothing may grow.

    python3 tests/campaign/long_run.py map --minutes 60 --bin build/ci/bin
    python3 tests/campaign/long_run.py live --minutes 60 --bin build/ci/bin [--rate 10]

One thread, at low priority. The scans of a lap are the same in each lap. Memory (resident), open handles, threads and
temporary files (also of folders of the system's that the run is told to use) are looked at every second. A run is wrong
if, between the second lap and the end, memory grows by more than 2 % and 4 MiB or one of the others at all, or unless it
ends by SIGINT with code 130 and without a temporary file. Prints a row for docs/benchmarks/campaigns.md."""
import argparse
import datetime
import os
import pathlib
import re
import shutil
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time

import loopback

FIELD = ["--tool", "builtin:pruner", "--voxel", "0.02", "--device", "cpu", "--range-noise", "0.01", "--threads", "1"]
FRAMES = 24
TOPICS = ["--cloud", "/livox/lidar", "--odom", "/Odometry"]


def simulate(options, world):
    subprocess.run([options.bin / "accessvdb-lab", "simulate", "--scene", "pine", "--tree-height", "4", "--trajectory", "orbit",
                    "--radius", "3", "--frames", str(FRAMES), "--range-noise", "0.01", "--out", world, "--quiet"], check=True)
    poses = [line.split() for line in (world / "poses.txt").read_text().splitlines() if not line.startswith("#")]
    return sorted((world / "scans").iterdir()), poses


def laps_of_files(scans, poses, folder, laps):
    """The same files again and again, with later stamps."""
    (folder / "scans").mkdir(parents=True)
    with open(folder / "poses.txt", "w", encoding="ascii") as out:
        for number in range(laps * FRAMES):
            stamp = f"{number / 10:.6f}"
            os.link(scans[number % FRAMES], folder / "scans" / f"{stamp.zfill(16)}.pcd")
            out.write(" ".join([stamp, *poses[number % FRAMES][1:]]) + "\n")


def points_of(pcd):
    """Of a binary PCD with x y z and perhaps more."""
    header, _, data = pcd.read_bytes().partition(b"DATA binary\n")
    words = {line.split()[0]: line.split()[1:] for line in header.decode().splitlines() if line and line[0] != "#"}
    step = sum(int(size) * int(count) for size, count in zip(words["SIZE"], words["COUNT"]))
    assert words["FIELDS"][:3] == ["x", "y", "z"] and words["SIZE"][:3] == ["4"] * 3, header
    return b"".join(data[at:at + 12] for at in range(0, int(words["POINTS"][0]) * step, step))


def feed(pipe, scans, poses):
    """Laps for live_peer until nobody reads them any more."""
    clouds = [points_of(scan) for scan in scans]
    try:
        with open(pipe, "wb") as out:
            number = 0
            while True:
                pose, cloud = poses[number % FRAMES], clouds[number % FRAMES]
                out.write(struct.pack("<q7dI", 1_700_000_000_000_000_000 + number * 100_000_000, *map(float, pose[1:]),
                                      len(cloud) // 12) + cloud)
                out.flush()
                number += 1
    except BrokenPipeError:
        pass


def sample(pid, folders):
    """Resident KiB, handles, threads, temporary files."""
    words = dict(line.split(":", 1) for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines() if ":" in line)
    files = sum(len(names) for folder in folders for _, _, names in os.walk(folder))
    return int(words["VmRSS"].split()[0]), len(os.listdir(f"/proc/{pid}/fd")), int(words["Threads"]), files


def done_scans(text, verb):
    """By the last line that says so."""
    found = re.findall(r"fusing scans (\d+) of" if verb == "map" else r"(\d+) of \d+ scans taken", text)
    return int(found[-1]) if found else 0


def run(options, scratch, domain):
    scans, poses = simulate(options, scratch / "world")
    (scratch / "temporary").mkdir()
    command = ["nice", "-n", "10", options.bin / "accessvdb", options.verb, *FIELD, "--out", scratch / "out"]
    others = []
    if options.verb == "map":
        laps_of_files(scans, poses, scratch / "laps", options.laps)
        command += ["--scans", scratch / "laps/scans", "--poses", scratch / "laps/poses.txt", "--update-every", "1"]
    else:
        os.mkfifo(scratch / "stream")
        command += [*TOPICS, "--domain", str(domain)]
    environment = {**os.environ, "TMPDIR": str(scratch / "temporary")}
    samples = []  # seconds, scans, and what sample() gives
    with open(scratch / "err", "w+b") as err:
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=err)
        if options.verb == "live":
            threading.Thread(target=feed, args=[scratch / "stream", scans, poses], daemon=True).start()
            others.append(subprocess.Popen(
                ["nice", "-n", "10", options.bin / "live_peer", scratch / "stream", f"domain={domain}",
                 f"rate={options.rate}"], env=loopback.environment(), stdout=subprocess.DEVNULL))
        began = time.monotonic()
        while process.poll() is None and time.monotonic() < began + 60 * options.minutes:
            time.sleep(1)
            if process.poll() is None:
                samples.append((time.monotonic() - began, done_scans((scratch / "err").read_text(errors="replace")[-4000:],
                                                                     options.verb),
                                *sample(process.pid, [scratch / "temporary", scratch / "out"])))
        ended_early = process.poll() is not None
        if not ended_early:
            process.send_signal(signal.SIGINT)
        code = process.wait(timeout=600)
        for other in others:
            other.kill()
            other.wait()
    problems = []
    text = (scratch / "err").read_text(errors="replace")
    if ended_early:
        problems.append(f"ended before its time: {text[-500:]}")
    if code != 130:
        problems.append(f"code {code}: {text[-500:]}")
    left = [str(path) for path in [*(scratch / "temporary").rglob("*"), *(scratch / "out").rglob(".*")]]
    if left:
        problems.append("left " + ", ".join(left))
    after = [row for row in samples if row[1] >= 2 * FRAMES]
    if len(after) < 20 or after[-1][1] < 6 * FRAMES:
        return problems + ["too short: no six laps"], code, samples, after
    tenth = max(5, len(after) // 10)
    first, last = after[:tenth], after[-tenth:]
    at_first, at_last = (statistics.median(row[2] for row in part) for part in (first, last))
    if at_last > 1.02 * at_first + 4096:
        problems.append(f"memory grows: {at_first:.0f} -> {at_last:.0f} KiB")
    for column, what in ((3, "handles"), (4, "threads"), (5, "temporary files")):
        if max(row[column] for row in last) > max(row[column] for row in first):
            problems.append(f"{what} grow: {max(row[column] for row in first)} -> {max(row[column] for row in last)}")
    return problems, code, samples, after


def commit():
    found = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False,
                           cwd=pathlib.Path(__file__).parent)
    return found.stdout.strip() or "?"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("verb", choices=("map", "live"))
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--bin", type=pathlib.Path, default="build/ci/bin")
    parser.add_argument("--laps", type=int, default=8000, help="map: of files; more than it gets done in the time")
    parser.add_argument("--rate", type=float, default=10, help="live: scans per second")
    options = parser.parse_args()
    options.bin = options.bin.resolve()
    scratch = pathlib.Path(tempfile.mkdtemp(prefix="accessvdb_long_"))
    try:
        with loopback.OwnDomain() as domain:
            problems, _, samples, after = run(options, scratch, domain)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    for problem in problems:
        print(f"{options.verb}: {problem}")
    if after:
        say = "; ".join(f"{what} {after[0][column]} → {after[-1][column]}, at most {max(row[column] for row in after)}"
                        for column, what in ((2, "KiB"), (3, "handles"), (4, "threads"), (5, "temporary and output files")))
        print(f"| {datetime.date.today()} | {commit()} | {os.cpu_count()} cores, release | `long_run.py {options.verb} "
              f"--minutes {options.minutes:g}`, from the second lap on: {say} | {samples[-1][1]} scans, "
              f"{samples[-1][1] / FRAMES:.0f} laps | {len(problems)} |")
    return 1 if problems or not after else 0


if __name__ == "__main__":
    sys.exit(main())
