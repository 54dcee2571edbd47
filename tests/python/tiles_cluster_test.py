# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""accessvdb.tiles with a scheduler and three workers of their own on loopback, and the real program: the bytes of one
piece, whatever is killed."""

import filecmp
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest
from pathlib import Path

SOURCE = Path(os.environ["SOURCE"])
WORK = Path(os.environ["WORK"], "tiles_cluster")
PROGRAM = os.environ["PROGRAM"]
MAP = ["--scans", str(WORK / "scans"), "--poses", str(WORK / "scans/poses.txt"), "--tool", "builtin:pencil"]
MAP += ["--voxel", "0.1", "--quiet", "--allow-hidden-tool"]
# The program, but it notes who has started it, and from the N-th tile on waits, N in the file "quick", until N is larger
# or standard input ends. So whoever is killed is killed while tiles run. Goes on where the folder is gone. The tile that
# the file "bad" names crashes.
SLOW = f"""#!/usr/bin/env -S /usr/bin/python3 -I -S
import os, select, subprocess, sys
from pathlib import Path

WORK, PROGRAM = Path({str(WORK)!r}), {PROGRAM!r}


def number(file, text):  # of a line that is added to a file
    with open(WORK / file, "a") as lines:
        lines.write(text + chr(10))
        end = lines.tell()
    return (WORK / file).read_bytes()[:end].count(10)


def held(n):
    try:
        return n > int((WORK / "quick").read_text())
    except OSError:
        return False


def rest(child, code=None):
    child.stdin.close()
    ended = child.wait()
    sys.exit(ended if code is None else code)


if sys.argv[2] != "run":
    os.execv(PROGRAM, [PROGRAM, *sys.argv[1:]])
number("started", f"{{os.getpid()}} {{os.getppid()}}")
if "--worker" not in sys.argv:
    while held(1):
        select.select([], [], [], 0.1)
    os.execv(PROGRAM, [PROGRAM, *sys.argv[1:]])
child = subprocess.Popen([PROGRAM, *sys.argv[1:]], stdin=subprocess.PIPE)
text, waiting = b"", []  # tiles with their numbers
while True:
    if child.poll() is not None:
        sys.exit(child.returncode)
    if select.select([0], [], [], 0.02)[0]:
        read = os.read(0, 4096)
        if not read:
            rest(child)
        text += read
        while chr(10).encode() in text:
            tile, _, text = text.partition(chr(10).encode())
            waiting.append((number("tiles", tile.decode()), tile))
    while waiting and not held(waiting[0][0]):
        tile = waiting.pop(0)[1]
        if (WORK / "bad").exists() and (WORK / "bad").read_text() == tile.decode():
            rest(child, 70)
        child.stdin.write(tile + chr(10).encode())
        child.stdin.flush()
"""


def quick(tiles):
    (WORK / "new").write_text(str(tiles))
    (WORK / "new").rename(WORK / "quick")


def parent(pid):
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if fields[0] in "ZX" else int(fields[1])


def started():
    """(child, parent) of the processes that run a tile now."""
    path = WORK / "started"
    pairs = [tuple(map(int, line.split())) for line in path.read_text().splitlines()] if path.exists() else []
    return [(child, by) for child, by in pairs if parent(child) is not None]


def until(condition, what, seconds=30):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.02)


class Cluster:
    """Debian's scheduler and workers, which know nothing of the Python package."""

    def __init__(self, workers):
        self.file = WORK / "scheduler.json"
        self.file.unlink(missing_ok=True)
        self.environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        self.environment["ACCESSVDB_PROGRAM"] = str(WORK / "slow")
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(self.file))
        self.workers = []
        until(lambda: self.file.exists() and self.address(), "the scheduler's file")
        for _ in range(workers):
            self.add_worker(self.address())

    def add_worker(self, address):
        self.workers.append(self._start("worker", address, "--no-nanny", "--nthreads", "1", "--host", "127.0.0.1"))
        return self.workers[-1]

    def address(self):
        try:
            return json.loads(self.file.read_text())["address"]
        except ValueError:  # half-written
            return None

    def _start(self, kind, *arguments):
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *arguments, "--dashboard-address", "127.0.0.1:0"]
        guard = shutil.which("setpriv")
        if guard:  # nothing of the cluster outlives this test, whatever kills it
            command = [guard, "--pdeathsig", "KILL", *command]
        with open(WORK / f"{kind}.log", "a") as log:
            return subprocess.Popen(command, env=self.environment, cwd=WORK, stdout=log, stderr=log)

    def end(self):
        for process in [self.scheduler, *self.workers]:
            process.kill()
            process.wait()


def setUpModule():
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    (WORK / "slow").write_text(SLOW)
    (WORK / "slow").chmod(0o755)
    quiet = {"stdout": subprocess.DEVNULL, "check": True}
    scans = ["--out", str(WORK / "scans"), "--frames", "12", "--rays", "4000", "--seed", "3", "--length", "24"]
    subprocess.run([os.environ["MAKE_SAMPLE_SCANS"], *scans, "--max-range", "12"], **quiet)
    subprocess.run([PROGRAM, "map", *MAP, "--device", "cpu", "--tiles", "off", "--out", str(WORK / "one")], **quiet)


class Tiles(unittest.TestCase):
    def setUp(self):
        for name in ("started", "tiles", "bad"):
            (WORK / name).unlink(missing_ok=True)
        self.out = WORK / self.id().rpartition(".")[2]
        subprocess.run([PROGRAM, "tile", "plan", str(self.out), *MAP, "--tiles", "12.8"], check=True)

    def start(self, *arguments):
        environment = dict(os.environ, PYTHONPATH=str(SOURCE / "python"), ACCESSVDB_PROGRAM=str(WORK / "slow"))
        command = [sys.executable, "-m", "accessvdb.tiles", "run", str(self.out), "--device", "cpu", *arguments]
        driver = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        self.addCleanup(driver.wait)
        self.addCleanup(driver.kill)
        self.addCleanup(driver.stderr.close)
        return driver

    def finish(self, driver, code):
        _, self.stderr = driver.communicate(timeout=90)
        self.assertEqual(driver.returncode, code, self.stderr)
        self.assertNotIn("Traceback", self.stderr)

    def check_bytes(self):
        merged = self.out / "all.ply"
        subprocess.run([PROGRAM, "tile", "merge", str(self.out), "--points", str(merged), "--quiet"], check=True)
        self.assertTrue(filecmp.cmp(merged, WORK / "one/points.ply", shallow=False))
        left = [path for path in self.out.rglob("*") if path.name.startswith(".") or path.name.endswith(".tmp")]
        self.assertEqual(left, [])

    def total(self):
        return len(subprocess.check_output([PROGRAM, "tile", "list", str(self.out)]).split())

    def done(self):
        return len(list(self.out.glob("tiles/[!.]*/tile.json")))

    def test_the_slow_program_ends_where_its_folder_is_gone(self):
        quick(0)
        waiting = subprocess.Popen([WORK / "slow", "tile", "run", str(self.out)], stdin=subprocess.PIPE, stderr=subprocess.PIPE)
        self.addCleanup(waiting.kill)
        self.addCleanup(waiting.stderr.close)
        self.addCleanup(waiting.stdin.close)
        until(started, "it waits")
        (WORK / "quick").unlink()
        self.assertEqual(waiting.wait(10), 3)  # as the program does without rays

    def test_a_tile_that_always_fails_is_named_and_the_rest_is_merged(self):
        quick(1000)
        subprocess.run([PROGRAM, "tile", "bin", str(self.out), "--quiet"], check=True)
        bad = subprocess.check_output([PROGRAM, "tile", "list", str(self.out)], text=True).split()[-1]
        (WORK / "bad").write_text(bad)
        self.finish(self.start("--workers", "2"), 70)
        self.assertRegex(self.stderr.splitlines()[-1], rf"error\[tile.poison\] .* 1 tile could not be mapped: {bad} ")
        report = json.loads((self.out / "report.json").read_text())
        self.assertIs(report["partial"], True)
        self.assertEqual([(tile["tile"], tile["exit_code"]) for tile in report["tiles"]["poison"]], [(bad, 70)])
        self.assertEqual(json.loads((self.out / "field.json").read_text())["missing"], [bad])
        status = subprocess.check_output([PROGRAM, "tile", "status", str(self.out)], text=True)
        self.assertIn(f"given up: {bad}, code 70: exit code 70", status)
        (WORK / "bad").unlink()
        self.finish(self.start("--workers", "1"), 0)
        self.assertIs(json.loads((self.out / "report.json").read_text())["partial"], False)
        self.check_bytes()

    def test_a_killed_worker_a_stopped_driver_and_a_killed_scheduler(self):
        cluster = Cluster(3)
        self.addCleanup(cluster.end)
        address = cluster.address()

        # A driver that is stopped: its children on the workers end too, what is finished stays.
        quick(1)
        driver = self.start("--scheduler", address)
        until(lambda: self.done() >= 1 and len(started()) == 3, "three processes at a time")
        driver.send_signal(signal.SIGTERM)
        self.finish(driver, 143)
        self.assertIn("stopped; the same command goes on from here", self.stderr)
        until(lambda: not started(), "the processes end")
        before = self.done()
        self.assertLess(before, self.total())

        # A worker that is killed takes its child along; its tile comes back on another one.
        quick(0)
        driver = self.start("--scheduler", address)
        until(lambda: len(started()) == 3, "three processes at a time")
        child, worker = started()[0]
        self.assertIn(worker, [process.pid for process in cluster.workers])
        os.kill(worker, signal.SIGKILL)
        until(lambda: parent(child) is None, "the child of a killed worker ends")
        quick(1000)
        until(lambda: self.done() > before, "the others go on")

        # So does a driver that is killed.
        quick(0)
        until(lambda: len(started()) == 2, "two processes at a time")
        driver.kill()
        self.finish(driver, -9)
        until(lambda: not started(), "the processes of a killed driver end")

        # A scheduler that is killed ends the driver with one line.
        driver = self.start("--scheduler", address)
        until(lambda: len(started()) == 2, "two processes at a time")
        begin = time.monotonic()
        cluster.scheduler.kill()
        self.finish(driver, 6)
        self.assertLess(time.monotonic() - begin, 30)
        self.assertRegex(self.stderr.splitlines()[-1], r"^accessvdb: error\[scheduler.lost\] tcp:.*Start it again and run")
        until(lambda: not started(), "the processes without a scheduler end")
        self.assertLess(self.done(), self.total())

        # The same command goes on, here with a cluster of its own, which a worker of another machine joins.
        driver = self.start("--workers", "1", "--host", "127.0.0.1")
        address = next(line for line in driver.stderr if "workers can join at " in line).split(" at ")[1].partition(";")[0]
        self.assertRegex(address, r"^tcp://127\.0\.0\.1:\d+$")
        worker = cluster.add_worker(address)
        until(lambda: worker.pid in [by for _, by in started()], "the worker that joined runs a tile")
        quick(1000)
        self.finish(driver, 0)
        self.assertIn("done; one file of all points", self.stderr)
        self.assertEqual(self.done(), self.total())
        self.check_bytes()


if __name__ == "__main__":
    if importlib.util.find_spec("distributed") is None:
        print("skipped: Python's module distributed is missing. On Debian and Ubuntu: apt install python3-distributed")
        sys.exit(77)
    unittest.main()
