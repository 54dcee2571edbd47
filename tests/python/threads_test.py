# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Threads: fields are independent, calls on one field take turns, and Python keeps running while the library works."""

import tempfile
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import accessvdb
import walls


def build(tool, frames=6):
    field = walls.field(frames=0, tool=tool)
    for n in range(frames):
        T_W_S = walls.pose(y=0.2 * n)
        field.integrate_scan(walls.scan(T_W_S, seed=n), T_W_S)
        field.update()
    return field.snapshot().records.tobytes()


class Threads(unittest.TestCase):
    def test_two_fields_in_two_threads(self):
        tools = ["builtin:pencil", "builtin:pruner"]
        expected = [build(tool) for tool in tools]
        self.assertNotEqual(*expected)
        for _ in range(3):
            with ThreadPoolExecutor(2) as threads:
                self.assertEqual(list(threads.map(build, tools)), expected)

    def test_one_field_in_many_threads(self):
        # Readers alongside a writer: every answer is that of a moment between two calls.
        field = walls.field(frames=0)
        sizes, seen, wrong, done = [0], [], [], threading.Event()

        def read():
            try:
                while not done.is_set():
                    least = sizes[-1]
                    snapshot = field.snapshot()
                    seen.append(len(snapshot))
                    if len(snapshot) < least:
                        wrong.append(len(snapshot))
                    field.query(snapshot.position_W[:10])
                    field.point_at((3, 0, 0))
                    field.memory_use()
            except Exception as error:
                wrong.append(error)

        readers = [threading.Thread(target=read) for _ in range(3)]
        for reader in readers:
            reader.start()
        for n in range(6):
            T_W_S = walls.pose(y=0.2 * n)
            stats = field.integrate_scan(walls.scan(T_W_S, seed=n), T_W_S)
            sizes.append(stats.surface_points)
            field.update()
        done.set()
        for reader in readers:
            reader.join()
        self.assertEqual(wrong, [])
        self.assertLessEqual(set(seen), set(sizes))
        self.assertEqual(field.snapshot().records.tobytes(), build("builtin:pruner"))

    def test_python_runs_on_during_long_calls(self):
        # While a call keeps the interpreter's lock, no other thread gets a turn: it sees a gap as long as the call.
        field = walls.field(frames=0, tsdf={"voxel_size_m": 0.015})  # fine enough for calls of 0.1 s on a fast machine
        T_W_S = walls.pose()
        points = np.asarray(walls.scan(T_W_S, rays=300_000), np.float32)
        turns, stop = [], threading.Event()

        def take_turns():
            while not stop.wait(0.001):
                turns.append(time.monotonic())

        other = threading.Thread(target=take_turns)
        other.start()
        self.addCleanup(other.join)
        self.addCleanup(stop.set)  # runs before the join
        long_calls = 0
        with tempfile.TemporaryDirectory() as folder:
            for call in (
                lambda: field.integrate_scan(points, T_W_S),
                field.update,
                field.evaluate_from_scratch,
                lambda: field.write(folder),
            ):
                begin = time.monotonic()
                call()
                end = time.monotonic()
                if end - begin < 0.1:
                    continue  # too short to distinguish from the system's own delays
                long_calls += 1
                inside = [begin, *(turn for turn in turns if begin < turn < end), end]
                self.assertLess(np.diff(inside).max(), 0.8 * (end - begin))
        self.assertGreaterEqual(long_calls, 2)

    def test_an_update_beside_the_next_scan(self):
        expected, expected_stats = walls.field(frames=0), []
        field, tickets = walls.field(frames=0), []
        for n in range(5):
            T_W_S = walls.pose(y=0.2 * n)
            points = walls.scan(T_W_S, seed=n)
            expected.integrate_scan(points, T_W_S)
            field.integrate_scan(points, T_W_S)
            expected_stats.append(expected.update())
            tickets.append(field.update_async())
        self.assertEqual(field.snapshot().records.tobytes(), expected.snapshot().records.tobytes())
        for ticket, stats in zip(tickets, expected_stats):
            self.assertTrue(ticket.done)  # the snapshot waited
            self.assertEqual(ticket.wait().direction_tests, stats.direction_tests)
            self.assertEqual(ticket.wait().moved_points, stats.moved_points)
            self.assertEqual(repr(ticket), "<accessvdb.UpdateTicket: done>")
        self.assertGreater(expected_stats[0].moved_points, 0)

    def test_a_ticket_keeps_the_outcome_of_a_field_that_is_gone(self):
        field = walls.field(frames=0)
        field.integrate_scan(walls.scan(walls.pose()), walls.pose())
        ticket = field.update_async()
        del field
        self.assertGreater(ticket.wait().scored_points, 0)
        del ticket
        field = walls.field(frames=0)
        field.integrate_scan(walls.scan(walls.pose()), walls.pose())
        field.update_async()  # dropped: waits
        self.assertGreater((field.snapshot().label != accessvdb.PointLabel.UNSCORED).sum(), 0)

    def test_python_runs_on_while_one_waits_for_a_ticket(self):
        field = walls.field(frames=0, tsdf={"voxel_size_m": 0.015})  # fine enough for an update of 0.1 s
        field.integrate_scan(np.asarray(walls.scan(walls.pose(), rays=300_000), np.float32), walls.pose())
        ticket, turns = field.update_async(), []
        with ThreadPoolExecutor(2) as threads:
            waiting = [threads.submit(ticket.wait), threads.submit(field.memory_use)]
            while not all(each.done() for each in waiting):
                turns.append(time.monotonic())
                time.sleep(0.001)
        self.assertGreater(len(turns), 10)
        self.assertGreater(waiting[0].result().scored_points, 0)


if __name__ == "__main__":
    unittest.main()
