#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Makes each of the first calls of the system fail, one run each, and judges what the program makes of it.

  failing_calls.py --program build/ci/bin/accessvdb --library build/ci/lib/libaccessvdb_failing_calls.so \
      [--cases map,tile-run] [--kinds write,malloc] [--first 500] [--sample N] [--seconds S] [--seed N] [--jobs N]

A run is wrong unless it ends with code 0, no error line and the bytes of an undisturbed run, or with a code of the
documentation and one error line; leaves every file as it was, or whole as the undisturbed run writes it, and no
temporary file; takes less than 20 s and 2 GB; and unless the same command without a fault then gives the bytes of the
undisturbed run. A library that gives up because it did not get memory or a thread (KNOWN) is counted, but is not wrong
if one line says so and no file is left. Prints each wrong run with the command that repeats it; the last line is "N runs, N
wrong". Returns 1 if a run was wrong. The case live needs --peer, the program live_peer of the tests; its outputs depend
on how fast the scans come, so they have to be whole, but not of the same bytes.
"""
import argparse
import concurrent.futures
import contextlib
import hashlib
import json
import math
import os
import pathlib
import random
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time

import loopback

# In the order of failing_calls.c, and what the system may answer.
ERRORS = {
    "open": ["EMFILE", "EACCES", "ENOSPC", "EMFILE+"],
    "read": ["EIO", "SHORT", "EIO+"],
    "write": ["ENOSPC+", "EIO", "SHORT", "EDQUOT", "ENOSPC"],
    "sync": ["EIO", "ENOSPC+"],
    "rename": ["EACCES", "ENOSPC", "EIO+"],
    "truncate": ["ENOSPC", "EIO+"],
    "mkdir": ["ENOSPC", "EACCES+", "EROFS"],
    "mmap": ["ENOMEM", "ENOMEM+"],
    "malloc": ["ENOMEM", "ENOMEM", "ENOMEM+"],
    "thread": ["EAGAIN", "EAGAIN+"],
    "fork": ["EAGAIN", "ENOMEM+"],
    "pipe": ["EMFILE", "EMFILE+"],
    "stat": ["EIO", "EACCES", "EIO+"],
    "opendir": ["EMFILE", "EACCES+"],
    "unlink": ["EACCES", "EIO+"],
    "close": ["EIO", "EIO+"],
}
DOCUMENTED = {3, 4, 5, 6, 7}  # 2 would blame the command, and 70 is a bug
# Libraries that use memory or threads which they did not get. Nothing can be done about it from outside than to say one
# line and to leave no file: tools/cli/output/last_line.cpp.
KNOWN = {
    "libblosc": "blosc_compress_ctx() does not check what my_malloc() returns",
    "libcrypto": "CRYPTO_THREAD_lock_new() of its first use, when the library's own context cannot be made",
    "libfastrtps": "Fast DDS joins threads that did not start, and allocates in functions that must not throw",
}
LIMIT_S = 20
LIMIT_BYTES = 2 << 30
ATTEMPT = re.compile(r"/\.[^/]*\.attempt-[0-9]+")
TEMPORARY = re.compile(r"^\..*\.[0-9a-f]{16}\.tmp$")


def same_of_report(text):
    """What does not depend on the time that a run took; that of a failed run is only that it is whole."""
    report = json.loads(text)
    if report["exit_code"] != 0:
        return "whole"
    outputs = [output for output in report.get("outputs", []) if output["path"] not in TIMED]
    return json.dumps([report["inputs"], outputs, report["counts"]])


def same_of_tile(text):
    tile = json.loads(text)
    return json.dumps({key: value for key, value in tile.items() if key not in ("seconds", "peak_bytes", "sha256")})


def same_of_page(text):
    if not text.rstrip().endswith("</html>"):
        raise ValueError("no end")
    return "whole"


# Files with times and memory in them.
TIMED = {"report.json": same_of_report, "tile.json": same_of_tile, "report.html": same_of_page}


def write_world(folder):
    """Scans of a rough wall with a slot, each another one; poses, a tool as a mesh, and a file of the user."""
    for part, scans in (("scans", range(3)), ("more", range(3, 5))):
        (folder / part).mkdir(parents=True)
        lines = []
        for scan in scans:
            points = []
            for row in range(16):
                for column in range(16):
                    y, z = -0.5 + (column + 0.5) / 16 + 1e-3 * scan, -0.5 + (row + 0.5) / 16
                    x = (2.4 if abs(y) < 0.04 else 2) + 0.01 * math.sin(31 * y + 17 * z + scan)
                    points.append(f"{x:.6f} {y:.6f} {z:.6f}")
            (folder / part / f"{100 + scan:06d}.000000.pcd").write_text(
                "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
                f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA ascii\n"
                + "\n".join(points) + "\n")
            lines.append(f"{100 + scan} 0 {0.1 * scan:.1f} 0 0 0 0 1")
        (folder / f"{part}.txt").write_text("\n".join(lines) + "\n")
    corners = [(x, y, z) for z in (-0.05, 0.05) for y in (-0.05, 0.05) for x in (0, 0.3)]
    faces = ["1 3 4", "1 4 2", "5 6 8", "5 8 7", "1 2 6", "1 6 5", "3 7 8", "3 8 4", "1 5 7", "1 7 3", "2 4 8", "2 8 6"]
    write_stream(folder / "stream")
    (folder / "tool.obj").write_text("".join("v %g %g %g\n" % corner for corner in corners)
                                     + "".join(f"f {face}\n" for face in faces))


def write_stream(file):
    """The same wall as live_peer sends it."""
    with open(file, "wb") as stream:
        for scan in range(3):
            stream.write(struct.pack("<q7dI", 1_700_000_000_000_000_000 + scan * 100_000_000, 0, 0.1 * scan, 0, 0, 0, 0, 1,
                                     256))
            for row in range(16):
                for column in range(16):
                    y, z = -0.5 + (column + 0.5) / 16 + 1e-3 * scan, -0.5 + (row + 0.5) / 16
                    stream.write(struct.pack("<3f", 2 + 0.01 * math.sin(31 * y + 17 * z + scan), y, z))


def inputs(part="scans"):
    return ["--scans", part, "--poses", part + ".txt"]


FIELD = ["--tool", "tool.obj", "--tool-unit", "m", "--voxel", "0.1", "--directions", "20", "--corridor", "0.2",
         "--device", "cpu", "--threads", "2", "--allow-hidden-tool", "--range-noise", "0.01"]


class Case:
    """A command, in a folder that `before` (commands without faults) has made."""

    def __init__(self, command, before=(), live=False, whole_paths=False):
        """@param whole_paths  the inputs are those of one folder for all runs: the outputs have their names"""
        self.command, self.before, self.live, self.whole_paths = command, before, live, whole_paths
        self.ends_well = 128 + signal.SIGINT if live else 0


MAP = ["map", *inputs(), *FIELD, "--out", "out"]
PLAN = [["tile", "plan", "out", *inputs(), *FIELD, "--tiles", "12.8"]]
CASES = {
    "map": Case(MAP),
    "map-again": Case(MAP + ["--html"], before=[["map", *inputs("more"), *FIELD, "--out", "out"]]),
    "map-in-tiles": Case(MAP + ["--tiles", "12.8"], whole_paths=True),
    "checkpoint": Case(MAP + ["--checkpoint", "state", "--resume", "state", "--checkpoint-every", "0"]),
    "resume": Case(["map", *inputs("more"), *FIELD, "--out", "out", "--resume", "state", "--checkpoint", "state",
                    "--checkpoint-every", "0"],
                   before=[["map", *inputs(), *FIELD, "--out", "first", "--checkpoint", "state"]]),
    "tile-bin": Case(["tile", "bin", "out"], before=PLAN),
    "tile-run": Case(["tile", "run", "out"], before=PLAN + [["tile", "bin", "out"]]),
    "live": Case(["live", "--cloud", "/livox/lidar", "--odom", "/Odometry", *FIELD, "--points-every", "0.2",
                  "--status-every", "0.2", "--scan-log", "log", "--out", "out"], live=True),
    "tile-merge": Case(["tile", "merge", "out"], before=PLAN + [["tile", "bin", "out"], ["tile", "run", "out"]]),
}


def hashes(folder):
    """Name to hash of each file; that of a timed file only says whether it is whole."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if not path.is_file():
            continue
        content = path.read_bytes()
        if path.name in TIMED:
            try:
                found[str(path.relative_to(folder))] = TIMED[path.name](content.decode())
            except (ValueError, KeyError):
                found[str(path.relative_to(folder))] = "damaged"
        else:
            found[str(path.relative_to(folder))] = hashlib.sha256(content).hexdigest()
    return found


def settled(files):
    """A run that found all done in a checkpoint makes no other, so the number of the last one differs, and with it its
    name. What it holds, the outputs show that are made from it."""
    return {re.sub(r"^state/state-\d+\.avst$", "state", file): "whole" if file.startswith("state/") else content
            for file, content in files.items()}


class Run:
    """One start of the program."""

    def __init__(self, options, case, command, folder, fault=None, count=None, trace=None):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("FAILING_CALLS")}
        if fault or count:
            environment["LD_PRELOAD"] = str(options.library)
            for name, value in (("", fault), ("_COUNT", count), ("_TRACE", trace)):
                if value:
                    environment["FAILING_CALLS" + name] = str(value)
        self.timed_out, self.failed = False, 0
        began = time.monotonic()
        with loopback.OwnDomain() if case.live else contextlib.nullcontext() as domain:
            with open(folder.parent / "err", "w+b") as err:
                process = subprocess.Popen(
                    [options.program, *command, *(["--domain", str(domain)] if case.live else [])], cwd=folder,
                    env=environment, stdout=subprocess.DEVNULL, stderr=err, stdin=subprocess.DEVNULL,
                    start_new_session=True, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CORE, (0, 0)))
                timer = threading.Timer(LIMIT_S, self.kill, [process])
                timer.start()
                if case.live:
                    threading.Thread(target=self.feed, args=[options, process, folder, domain], daemon=True).start()
                _, status, usage = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
                timer.cancel()
            self.err = (folder.parent / "err").read_text(errors="replace")
        self.code = process.returncode
        self.bytes = usage.ru_maxrss * 1024
        self.seconds = time.monotonic() - began

    def kill(self, process):
        self.timed_out = True
        os.kill(process.pid, signal.SIGKILL)

    @staticmethod
    def feed(options, process, folder, domain):
        """Sends the scans once the program is ready, and then stops it."""
        try:
            while process.returncode is None and b"waiting for" not in (folder.parent / "err").read_bytes():
                time.sleep(0.02)
        except FileNotFoundError:
            return  # it has ended, and nothing is left of it
        if process.returncode is None:
            try:
                subprocess.run([options.peer, "stream", f"domain={domain}", "rate=20", "wait_s=5"], cwd=folder, check=False,
                               env=loopback.environment(), stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL, timeout=LIMIT_S / 2)
            except subprocess.TimeoutExpired:
                pass  # the program does not hear it
        time.sleep(0.2)
        if process.returncode is None:
            process.send_signal(signal.SIGINT)


class Campaign:
    def __init__(self, options):
        self.options = options
        self.root = pathlib.Path(tempfile.mkdtemp(prefix="accessvdb_faults_"))
        self.lock = threading.Lock()
        self.runs = self.wrong = 0
        self.ends, self.known = {}, {}

    def prepare(self, name):
        """The folder that every run of the case starts from, what an undisturbed run leaves, and how many calls it
        makes of each kind."""
        case = CASES[name]
        start = self.root / name / "start"
        write_world(start)
        for command in case.before:
            run = Run(self.options, Case(command), command, start)
            if run.code != 0:
                sys.exit(f"{name}: {' '.join(command)}: {run.code}\n{run.err}")
        if (start / "out").exists():
            (start / "out" / "notes.txt").write_text("of the user\n")
        if case.whole_paths:
            case.command = [str(start / word) if word in ("scans", "scans.txt", "tool.obj") else word
                            for word in case.command]
        case.start, case.old = start, hashes(start)
        whole = self.root / name / "whole"
        shutil.copytree(start, whole)
        count = self.root / name / "count"
        run = Run(self.options, case, case.command, whole, count=count)
        if run.code != case.ends_well:
            sys.exit(f"{name}: {' '.join(case.command)}: {run.code}\n{run.err}")
        case.new = hashes(whole)
        calls = struct.unpack(f"={len(ERRORS)}Q", count.read_bytes()[:8 * len(ERRORS)])
        case.calls = dict(zip(ERRORS, calls))
        print(f"{name}: {run.seconds:.2f} s, {run.bytes >> 20} MB, calls "
              + ", ".join(f"{kind} {number}" for kind, number in case.calls.items()), flush=True)

    def faults(self, name):
        """Of each kind the first calls, and some of the later ones."""
        case, chosen = CASES[name], []
        for kind in self.options.kinds:
            last = case.calls[kind]
            numbers = list(range(1, min(self.options.first, last) + 1))
            later = range(self.options.first + 1, last + 1)
            numbers += sorted(random.Random(f"{self.options.seed} {name} {kind}").sample(
                later, min(self.options.sample, len(later))))
            for number in numbers:
                error = ERRORS[kind][(number + self.options.seed) % len(ERRORS[kind])]
                chosen.append((name, f"{kind}:{number}{'+' if error[-1] == '+' else ''}:{error.rstrip('+')}"))
        return chosen

    def judge(self, name, fault):
        case = CASES[name]
        with tempfile.TemporaryDirectory(dir=self.root) as scratch:
            folder = pathlib.Path(scratch) / "run"
            shutil.copytree(case.start, folder)
            trace = pathlib.Path(scratch) / "trace"
            run = Run(self.options, case, case.command, folder, fault, pathlib.Path(scratch) / "count", trace)
            problems = self.problems(case, fault, run, folder)
            after = hashes(folder)
            # Files are all that a run leaves: where they are as before or as they should be, the next run is known.
            if after not in (case.old, case.new) and not case.live:
                again = Run(self.options, case, case.command, folder)
                if again.code != 0:
                    problems.append(f"the same command again ends with {again.code}: {again.err.strip()[-300:]}")
                elif (now := settled(hashes(folder))) != (new := settled(case.new)):
                    names = [file for file in {*now, *new} if now.get(file) != new.get(file)]
                    problems.append("the same command again gives other bytes of " + ", ".join(sorted(names)))
            elif case.live and (folder / "out" / "field.vdb").exists():
                again = Run(self.options, Case([]), ["info", "out"], folder)
                if again.code != 0:
                    problems.append(f"leaves outputs that are not whole: {again.err.strip()[-300:]}")
            stack = trace.read_text(errors="replace") if trace.exists() else ""
            counts = struct.unpack(f"={2 * len(ERRORS)}Q", (pathlib.Path(scratch) / "count").read_bytes())
            run.failed = sum(counts[len(ERRORS):])
        return problems, run, stack

    def problems(self, case, fault, run, folder):
        problems = []
        if run.timed_out:
            return [f"still runs after {LIMIT_S} s"]
        if run.bytes > LIMIT_BYTES:
            problems.append(f"takes {run.bytes >> 20} MB")
        errors = [line for line in run.err.splitlines() if line.startswith("accessvdb: error[")]
        others = [line for line in run.err.splitlines() if not line.startswith("accessvdb: ")]
        after = hashes(folder)
        if run.code == case.ends_well:
            if errors:
                problems.append("ends well but says " + errors[0])
            without_checkpoint = "warning[checkpoint.failed]" in run.err
            wrong = [file for file, content in case.new.items() if after.get(file) != content
                     and not (without_checkpoint and file.startswith("state/")) and not case.live]
            if wrong:
                problems.append("ends with 0 but these are not as they should be: " + ", ".join(wrong))
        elif run.code < 0:
            problems.append("ends by " + signal.Signals(-run.code).name)
        elif run.code == 70 and len(errors) == 1:
            problems.append("gives up: " + errors[0])
        elif run.code not in DOCUMENTED:
            problems.append(f"ends with {run.code}: {run.err.strip()[-300:]}")
        elif len(errors) != 1:
            problems.append(f"ends with {run.code} and {len(errors)} error lines: {run.err.strip()[-300:]}")
        if others:
            problems.append("prints " + others[0])
        for file, content in after.items():
            base = file.rsplit("/", 1)[-1]
            if TEMPORARY.match(base):
                if not fault.startswith("unlink"):  # what cannot be deleted is left to the next run
                    problems.append("leaves " + file)
            elif ATTEMPT.search(file):
                # To delete a folder takes memory and a look at its files.
                if not fault.startswith(("unlink", "opendir", "open", "stat", "malloc")):
                    problems.append("leaves " + file)
            elif content not in (case.old.get(file), case.new.get(file)) and not self.own(case, file, content):
                problems.append("leaves another " + file)
        for file in case.old:
            if file not in after and file in case.new:
                problems.append("deletes " + file)
        return problems

    @staticmethod
    def own(case, file, content):
        """Files whose content may differ from both: reports of a failure, and what a run writes on its way, which the
        second run judges."""
        return ((file.endswith("report.json") and content == "whole") or case.live
                or file.startswith("state/") or (file.startswith("out/rays/") and file not in case.new))

    def one(self, job):
        if self.options.seconds and time.monotonic() > self.end:
            return
        name, fault = job
        problems, run, stack = self.judge(name, fault)
        with self.lock:
            self.runs += 1
            end = "without the fault" if run.failed == 0 else f"code {run.code}"
            self.ends[end] = self.ends.get(end, 0) + 1
            known = next((library for library in KNOWN if library in stack), None)
            told = all(problem.startswith(("gives up", "prints ")) for problem in problems)
            if known and problems and told and fault.startswith(("malloc", "thread")):
                self.known[known] = self.known.get(known, 0) + 1
                return
            if not problems:
                return
            self.wrong += 1
            print(f"\n{name} {fault} (code {run.code}): " + "; ".join(problems))
            print(f"  {self.options.own} --cases {name} --only {fault}", flush=True)
            if self.options.stacks:
                print("  " + run.err.strip().replace("\n", "\n  ")[-1000:])
                print(frames(stack, self.options.program), flush=True)

    def work(self):
        for name in self.options.cases:
            self.prepare(name)
        jobs = [fault for name in self.options.cases for fault in self.faults(name)]
        if self.options.only:
            jobs = [(name, self.options.only) for name in self.options.cases]
        if self.options.seconds:
            random.Random(self.options.seed).shuffle(jobs)
            self.end = time.monotonic() + self.options.seconds
        with concurrent.futures.ThreadPoolExecutor(self.options.jobs) as pool:
            for _ in pool.map(self.one, jobs):
                pass
        print(", ".join(f"{count} {end}" for end, count in sorted(self.ends.items())))
        for library, count in sorted(self.known.items()):
            print(f"{count} known crashes in {library}: {KNOWN[library]}")
        print(f"{self.runs} runs, {self.wrong} wrong")
        return 1 if self.wrong else 0


def frames(stack, program):
    """The names in a stack, innermost first."""
    try:
        names = subprocess.run(["c++filt"], input=stack, capture_output=True, text=True, check=False).stdout
    except OSError:
        names = stack
    return "\n".join("    " + line[:180] for line in names.splitlines()[2:26])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--program", required=True)
    parser.add_argument("--library", required=True)
    parser.add_argument("--peer")
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--kinds", default=",".join(ERRORS))
    parser.add_argument("--first", type=int, default=500, help="calls of each kind, from the first on")
    parser.add_argument("--sample", type=int, default=0, help="of the calls after these, chosen by the seed")
    parser.add_argument("--seconds", type=float, default=0, help="stops then, after faults in an order of the seed")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--only", help="one fault, for example write:17:ENOSPC")
    parser.add_argument("--stacks", action="store_true", help="what was said, and the stack of the call")
    options = parser.parse_args()
    options.program = str(pathlib.Path(options.program).resolve())
    options.library = pathlib.Path(options.library).resolve()
    options.cases, options.kinds = options.cases.split(","), options.kinds.split(",")
    if options.peer:
        options.peer = pathlib.Path(options.peer).resolve()
    else:
        options.cases = [case for case in options.cases if case != "live"]
    options.own = f"{sys.argv[0]} --program {options.program} --library {options.library}"
    campaign = Campaign(options)
    try:
        return campaign.work()
    finally:
        shutil.rmtree(campaign.root, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
