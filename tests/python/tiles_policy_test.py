# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""accessvdb.tiles with a program that fails as it is told: what is retried, split, given up; locks, signals, GPUs."""

import contextlib
import fcntl
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

SOURCE = Path(os.environ["SOURCE"])
sys.path.insert(0, str(SOURCE / "python"))
FAKE = str(SOURCE / "tests/python/fake_accessvdb.py")
# The package as it is in the sources: without the compiled module.
ENVIRONMENT = dict(os.environ, PYTHONPATH=str(SOURCE / "python"), ACCESSVDB_PROGRAM=FAKE)
GRID = {"tile_voxels": 512, "margin_voxels": 30}  # quarters down to 128 voxels: two levels


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def until(condition, what, seconds=20):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.05)


class Tiles(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.out = Path(folder.name, "out")
        self.out.mkdir()
        (self.out / "plan.json").write_text(json.dumps(GRID))

    def start(self, script, *arguments, environment=ENVIRONMENT, python=()):
        (self.out / "script.json").write_text(json.dumps(script))
        command = [sys.executable, *python, "-m", "accessvdb.tiles", "run", str(self.out), *arguments]
        child = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.addCleanup(child.wait)
        self.addCleanup(child.kill)
        return child

    def finish(self, child, code):
        out, self.stderr = child.communicate(timeout=60)
        self.assertEqual(child.returncode, code, self.stderr)
        self.assertEqual(out, "")
        self.assertNotIn("Traceback", self.stderr)
        return self.stderr

    def run_all(self, script, code, *arguments, **more):
        return self.finish(self.start(script, "--workers", "3", *arguments, **more), code)

    def log(self, step):
        path = self.out / "log"
        lines = path.read_text().splitlines() if path.exists() else []
        return [entry for entry in map(json.loads, lines) if entry["step"] == step]

    def attempts(self):
        count = {}
        for entry in self.log("run"):
            count[entry["tile"]] = count.get(entry["tile"], 0) + 1
        return count

    def error(self, id):
        lines = [line for line in self.stderr.splitlines() if "error[" in line]
        self.assertEqual(len(lines), 1, self.stderr)
        self.assertTrue(lines[0].startswith(f"accessvdb: error[{id}] "), lines[0])
        return lines[0]

    # ---- after a failure ----------------------------------------------------------------------------------------------

    def test_retries_and_quarters(self):
        script = {
            "0_0": ["ok"],
            "1_0": ["error 5 limit.memory"],
            "1_0.1": ["error 5 limit.memory"],
            "2_0": ["error 6 device.lost", "error 6 device.lost", "ok"],
            "3_0": ["kill 11", "exit 70", "ok"],
            "4_0": ["error 7 output.disk_full", "ok"],
            "5_0": ["grow 36"],
            "6_0": ["kill 9", "exit 137", "ok"],
            "7_0": ["nothing", "ok"],
            "8_0": ["exit 134", "exit 143", "ok"],
            # A crash does not use up the disk's retry.
            "9_0": ["kill 6", "error 7 output.disk_full", "ok"],
        }
        self.run_all(script, 0, "--max-memory", "40M")
        quarters = {f"1_0.{digit}": 1 for digit in "0123"} | {f"1_0.1{digit}": 1 for digit in "0123"}
        quarters |= {f"5_0.{digit}": 1 for digit in "0123"}
        whole = {"0_0": 1, "1_0": 1, "2_0": 3, "3_0": 3, "4_0": 2, "5_0": 1, "6_0": 3, "7_0": 2, "8_0": 3, "9_0": 3}
        self.assertEqual(self.attempts(), {**whole, **quarters})
        self.assertEqual([len(self.log(step)) for step in ("bin", "merge")], [1, 1])
        self.assertRegex(self.stderr, r"tile 5_0 is run as quarters: killed by SIGKILL at \d+ of 40 MiB")
        # One that ends with 0 and nothing else may have left just before it was asked, which is not counted.
        self.assertRegex(self.stderr, r"mapped 19 tiles with 57 points in .* \(3 split, 1[12] retried\)")
        for entry in self.log("run"):
            arguments = entry["arguments"]
            self.assertEqual(arguments[arguments.index("--max-memory") + 1], "40M", "quarters have the limit of the whole")
            self.assertIn("--worker", arguments)
            self.assertIsNone(entry["gpu"])
        # Another run has nothing left to do.
        self.run_all(script, 0)
        self.assertEqual(self.attempts(), {**whole, **quarters})
        self.assertEqual([len(self.log(step)) for step in ("bin", "merge")], [1, 2])

    def test_poison(self):
        script = {"0_0": ["error 6 device.lost"], "1_0": ["kill 11"], "2_0": ["error 5 limit.memory"], "3_0": ["sleep 1"]}
        script["2_0.33"] = script["2_0.3"] = ["error 5 limit.memory"]
        self.run_all(script, 6)
        line = self.error("tile.poison")
        self.assertRegex(line, "3 tiles could not be mapped: 0_0, 1_0, 2_0.33 .*device.lost.*all others are finished")
        expected = {"0_0": 3, "1_0": 3, "2_0": 1, "3_0": 1}
        expected |= {f"2_0.{digit}": 1 for digit in "0123"} | {f"2_0.3{digit}": 1 for digit in "0123"}
        self.assertEqual(self.attempts(), expected)
        # What is finished is merged, from rays that stay, and the others are named for the report.
        self.assertEqual([entry["arguments"] for entry in self.log("merge")], [["--keep-rays", "--partial"]])
        marks = {path.name: json.loads(path.read_text()) for path in self.out.glob("tiles/*.poison.json")}
        self.assertEqual(sorted(marks), ["0_0.poison.json", "1_0.poison.json", "2_0.33.poison.json"])
        self.assertEqual([mark["exit_code"] for _, mark in sorted(marks.items())], [6, 70, 5])
        self.assertIn("SIGSEGV", marks["1_0.poison.json"]["reason"])
        # They are tried again by the same command, and only they.
        for tile in ("0_0", "1_0", "2_0.33"):
            script[tile] = ["ok"]
        self.run_all(script, 0)
        self.assertEqual(self.attempts(), {**expected, "0_0": 4, "1_0": 4, "2_0.33": 2})
        self.assertEqual(list(self.out.glob("tiles/*.poison.json*")), [])

    def test_a_full_disk_stops_the_run(self):
        script = {"0_0": ["error 7 output.disk_full"], "1_0": ["wait"], **{f"{n}_9": ["sleep 0.2"] for n in range(30)}}
        self.run_all(script, 7)
        self.error("output.disk_full")
        self.assertEqual(self.attempts()["0_0"], 2)
        self.assertLess(len(self.attempts()), 20)
        self.assertEqual([entry["tile"] for entry in self.log("stopped")], ["1_0"])
        self.assertEqual(self.log("merge"), [])

    def test_bad_input_stops_the_run_at_once(self):
        self.run_all({"0_0": ["error 3 rays.damaged"], **{f"{n}_9": ["wait"] for n in range(9)}}, 3)
        self.assertIn("tile 0_0", self.error("rays.damaged"))
        self.assertEqual(self.attempts()["0_0"], 1)
        self.assertLess(len(self.attempts()), 5)
        self.assertEqual(self.log("merge"), [])

    def test_every_ending(self):
        from accessvdb import _tile_policy as policy

        stop, split, again, done = "STOP", "QUARTERS", "RETRY", "DONE"
        rows = [
            # exit code, error, part of the limit: what follows, time after time, for a tile that can be split
            (0, "", 0.5, [done]),
            (2, "usage.tile", 0.1, [stop]),
            (3, "rays.damaged", 0.1, [stop]),
            (4, "plan.changed", 0.1, [stop]),
            (5, "limit.memory", 0.1, [split]),
            (5, "tool.span", 0.1, [stop]),
            (6, "device.lost", 0.1, [again, again, "POISON"]),
            (7, "output.disk_full", 0.1, [again, stop]),
            (70, "internal.exception", 0.1, [again, again, "POISON"]),
            (1, "", 0.1, [again, again, "POISON"]),
            (127, "", 0.1, [stop]),
            (-9, "", 0.81, [split]),
            (-9, "", 0.79, [again, again, "POISON"]),
            (137, "", 0.81, [split]),
            (137, "", 0.79, [again, again, "POISON"]),
            (-11, "", 0.99, [again, again, "POISON"]),
            (139, "", 0.99, [again, again, "POISON"]),
            (134, "", 0.1, [again, again, "POISON"]),
            (143, "", 0.1, [again, again, "POISON"]),
        ]
        for code, id, part, expected in rows:
            with self.subTest(code=code, part=part):
                ledger = policy.Ledger(policy.Grid(512, 30))
                outcome = {"tile": "0_0", "code": code, "error": {"id": id} if id else {}, "tiles": [{}] if code == 0 else [],
                           "peak_bytes": int(part * 1000), "limit_bytes": 1000, "stalled": False}  # fmt: skip
                self.assertEqual([ledger.judge(outcome).name for _ in expected], expected)

    def test_what_dask_says_instead_of_a_result(self):
        from accessvdb import InternalError
        from accessvdb._tile_cluster import Cluster, SchedulerLost

        class Future:
            def __init__(self, error, status="error"):
                self.error, self.status = error, status

            def result(self, timeout):
                raise self.error

        cluster = Cluster(None, "")
        self.assertIsNone(cluster.result(Future(type("KilledWorker", (Exception,), {})())))
        for lost in (Future(None, "cancelled"), Future(type("CancelledError", (Exception,), {})()), Future(TimeoutError())):
            self.assertRaises(SchedulerLost, cluster.result, lost)
        with self.assertRaises(InternalError) as caught:  # such as bytecode of another Python
            cluster.result(Future(TypeError("code expected at most 16 arguments")))
        self.assertIn("same versions of Python", str(caught.exception))

    def test_quarters_end_where_the_program_ends(self):
        from accessvdb._tile_policy import Grid

        self.assertEqual(Grid(512, 30).quarters("-3_2"), ["-3_2.0", "-3_2.1", "-3_2.2", "-3_2.3"])
        self.assertEqual(Grid(512, 30).quarters("-3_2.3"), ["-3_2.30", "-3_2.31", "-3_2.32", "-3_2.33"])
        self.assertEqual(Grid(512, 30).quarters("-3_2.31"), [])  # 64 voxels
        self.assertEqual(Grid(512, 65).quarters("-3_2.3"), [])  # 128 voxels, less than two margins

    def test_what_has_gone_has_no_quarters(self):
        from accessvdb._tile_folder import read_grid

        self.assertTrue(read_grid(str(self.out)).quarters("0_0"))
        for mode in ("block", "full"):
            (self.out / "plan.json").write_text(json.dumps({**GRID, "parameters": f"seed 1\nchange {mode}\nfree_for_s inf\n"}))
            self.assertEqual(bool(read_grid(str(self.out)).quarters("0_0")), mode == "block")

    def test_a_process_goes_on_until_a_tile_fails(self):
        names = [f"{n}_0" for n in range(12)]
        script = {"9_9": ["kill 11", "ok"], **{name: ["sleep 0.2"] for name in names}}
        self.finish(self.start(script, "--workers", "2"), 0)
        runs = self.log("run")
        crashed = [entry["pid"] for entry in runs if entry["tile"] == "9_9"][0]
        self.assertEqual(len({entry["pid"] for entry in runs}), 3)  # one for each slot, and one in place of the crashed one
        self.assertEqual(max(n for n, entry in enumerate(runs) if entry["pid"] == crashed),
                         [n for n, entry in enumerate(runs) if entry["tile"] == "9_9"][0])  # fmt: skip
        until(lambda: not any(alive(entry["pid"]) for entry in runs), "the end of all")

    def test_a_process_that_leaves_costs_no_tile(self):
        names = [f"{n}_0" for n in range(5)]
        self.finish(self.start({name: ["leave"] for name in names}, "--workers", "1"), 0)
        self.assertEqual(self.attempts(), {name: 1 for name in names})
        self.assertNotIn("retried", self.stderr)
        self.assertEqual(len({entry["pid"] for entry in self.log("run")}), 5)

    def test_a_stopped_process_is_run_again(self):
        self.run_all({"0_0": ["kill 19", "ok"], "1_0": ["ok"]}, 0, "--stall-timeout", "1")
        self.assertEqual(self.attempts(), {"0_0": 2, "1_0": 1})
        self.assertIn("tile 0_0 is run again: used no processor time", self.stderr)
        self.assertFalse(any(alive(entry["pid"]) for entry in self.log("run")))

    # ---- one driver, signals ------------------------------------------------------------------------------------------

    def test_two_drivers_and_other_writers(self):
        first = self.start({"0_0": ["wait"], "1_0": ["ok"]}, "--workers", "2")
        until(lambda: self.log("end"), "a finished tile")
        self.run_all({"0_0": ["wait"], "1_0": ["ok"]}, 7)
        self.error("output.locked")
        folder = os.open(self.out, os.O_RDONLY)
        self.addCleanup(os.close, folder)
        with self.assertRaises(BlockingIOError):  # what `accessvdb map` asks for
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        first.send_signal(signal.SIGINT)
        self.finish(first, 130)
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self.run_all({"0_0": ["ok"], "1_0": ["ok"]}, 7)  # now `map` has it
        self.error("output.locked")
        fcntl.flock(folder, fcntl.LOCK_UN)
        self.run_all({"0_0": ["ok"], "1_0": ["ok"]}, 0)
        self.assertEqual(self.attempts(), {"0_0": 2, "1_0": 1})

    def test_sigterm_and_sigkill(self):
        for number, code in ((signal.SIGTERM, 143), (signal.SIGKILL, -9)):
            driver = self.start({"0_0": ["wait"], "1_0": ["wait"]}, "--workers", "2")
            until(lambda: len(self.log("run")) - len(self.log("stopped")) == 2, "two processes")
            driver.send_signal(number)
            self.finish(driver, code)
            if number == signal.SIGTERM:
                self.assertIn("stopped; the same command goes on from here", self.stderr)
                self.assertFalse(any(alive(entry["pid"]) for entry in self.log("run")), "ended before the driver")
            until(lambda: not any(alive(entry["pid"]) for entry in self.log("run")), "processes without a driver end")

    def test_the_step_before_the_tiles_ends_with_the_driver(self):
        (self.out / "slow_bin").touch()
        for number, code in ((signal.SIGINT, 130), (signal.SIGKILL, -9)):
            if number == signal.SIGKILL and not shutil.which("setpriv"):
                continue
            driver = self.start({"0_0": ["ok"]}, "--workers", "1")
            until(lambda: any(alive(entry["pid"]) for entry in self.log("bin")), "the step bin")
            driver.send_signal(number)
            self.finish(driver, code)
            until(lambda: not any(alive(entry["pid"]) for entry in self.log("bin")), "its end")
        self.assertEqual(self.log("run"), [])

    # ---- GPUs ---------------------------------------------------------------------------------------------------------

    def test_gpus(self):
        names = [f"{n}_0" for n in range(18)]
        # The first ones wait until there are six, however long a busy machine takes to start them.
        child = self.start({name: ["beside 6"] for name in names}, "--gpus", "0,2,GPU-5f", "--per-gpu", "2")
        self.finish(child, 0)
        events = sorted([(e["at"], 1, e["gpu"]) for e in self.log("run")] + [(e["at"], -1, e["gpu"]) for e in self.log("end")])
        busy, most, total = {}, {}, []
        for _, step, gpu in events:
            busy[gpu] = busy.get(gpu, 0) + step
            most[gpu] = max(most.get(gpu, 0), busy[gpu])
            total.append(sum(busy.values()))
        self.assertEqual(most, {"0": 2, "2": 2, "GPU-5f": 2})
        self.assertEqual(max(total), 6)
        for entry in self.log("run"):
            arguments = entry["arguments"]
            self.assertEqual(arguments[arguments.index("--device") + 1], "cuda")

    # ---- words --------------------------------------------------------------------------------------------------------

    def test_misuse(self):
        script = {"0_0": ["ok"]}
        for arguments, id in (
            (["--workers", "0"], "usage.range"),
            (["--workers", "x"], "usage.flag"),
            (["--scheduler", "tcp://127.0.0.1:1", "--gpus", "0"], "usage.conflict"),
            (["--workers", "2", "--gpus", "0"], "usage.conflict"),
            (["--stall-timeout", "nan"], "usage.range"),
        ):
            with self.subTest(arguments=arguments):
                self.finish(self.start(script, *arguments), 2)
                self.error(id)
        self.finish(self.start(script, "--workers", "1", environment={**ENVIRONMENT, "ACCESSVDB_PROGRAM": "/no/such"}), 2)
        self.error("program.missing")
        self.finish(self.start(script, "--workers", "1", python=("-S",)), 2)  # -S: no packages of the distribution
        self.assertIn("apt install python3-distributed", self.error("dask.missing"))
        self.finish(self.start(script, "--scheduler", "tcp://127.0.0.1:1"), 6)
        self.error("scheduler.missing")
        (self.out / "plan.json").write_text("{")
        self.finish(self.start(script), 3)
        self.error("plan.damaged")
        (self.out / "plan.json").unlink()
        self.finish(self.start(script), 3)
        self.error("plan.missing")

    def test_no_port_is_open_to_others(self):
        driver = self.start({"0_0": ["wait"]}, "--workers", "1")
        until(lambda: self.log("run"), "a process")
        sockets = set()
        for file in Path(f"/proc/{driver.pid}/fd").iterdir():
            with contextlib.suppress(FileNotFoundError):  # closed in the meantime
                sockets.add(os.readlink(file))
        listening = []
        for table in ("tcp", "tcp6"):
            for line in Path(f"/proc/{driver.pid}/net/{table}").read_text().splitlines()[1:]:
                fields = line.split()
                if fields[3] == "0A" and f"socket:[{fields[9]}]" in sockets:
                    listening.append(fields[1].partition(":")[0])
        self.assertEqual(set(listening) - {"0100007F"}, set())
        driver.terminate()
        self.finish(driver, 143)

    def test_the_compiled_module_is_missed_only_where_it_is_used(self):
        code = (
            "import accessvdb, accessvdb.tiles\n"
            "from accessvdb import tiles, OutputError\n"
            "for use in ('accessvdb.AccessibilityField', 'accessvdb.__version__'):\n"
            "    try: eval(use)\n"
            "    except ModuleNotFoundError as error: assert error.name == 'accessvdb._accessvdb', error\n"
            "    else: raise SystemExit('no error')\n"
            "try: from accessvdb import *\n"
            "except ModuleNotFoundError: pass\n"
            "else: raise SystemExit('no error')\n"
            "assert not hasattr(accessvdb, '__wrapped__')\n"
        )
        subprocess.run([sys.executable, "-W", "error", "-c", code], env=ENVIRONMENT, check=True)


if __name__ == "__main__":
    if importlib.util.find_spec("distributed") is None:
        print("skipped: Python's module distributed is missing. On Debian and Ubuntu: apt install python3-distributed")
        sys.exit(77)
    unittest.main()
