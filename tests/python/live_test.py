# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""A live session in Python gives what a field gives that is fed with the same scans, and accounts for every scan."""

import os
import tempfile
import threading
import unittest
from pathlib import Path

import numpy as np
import walls

import accessvdb

FIRST_NS = 1_700_000_000_000_000_000
UNTURNED = (0, 0, 0, 1)


def stamp(n):
    return FIRST_NS + n * 100_000_000


def session(**options):
    tool = accessvdb.ToolGeometry.builtin("builtin:pruner")
    return accessvdb.LiveSession(tool, {"tsdf": {"voxel_size_m": walls.VOXEL_M}}, **options)


def fed(numbers):
    """A field that scored after each of these scans."""
    field = accessvdb.AccessibilityField(
        accessvdb.ToolGeometry.builtin("builtin:pruner"), {"tsdf": {"voxel_size_m": walls.VOXEL_M}}
    )
    for n in numbers:
        T_W_S = walls.pose(y=0.2 * n)
        field.integrate_scan(walls.scan(T_W_S, seed=n), T_W_S)
        field.update()
    return field.snapshot()


class Live(unittest.TestCase):
    def assert_same(self, a, b):
        self.assertEqual(len(a), len(b))
        for name in ("position_W", "label", "reason", "score", "direction", "confidence", "stability"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)

    def send(self, live, n, **frame):
        live.add_scan(stamp(n), walls.scan(walls.pose(y=0.2 * n), seed=n), **frame)
        live.add_pose(stamp(n), (0, 0.2 * n, 0), UNTURNED, **frame)

    def test_labels_are_those_of_a_field(self):
        live = session()
        known = {}
        for n in range(4):
            self.assertFalse(live.wait_for_work(0))
            self.assertIsNone(live.step())
            self.send(live, n)
            self.assertTrue(live.wait_for_work(0))
            step = live.step()
            self.assertEqual((step.number, step.stamp_ns), (n, stamp(n)))
            self.assertGreater(step.fused.points_used, 5000)
            self.assertGreaterEqual(step.latency_ms, step.waited_ms)
            known.update(zip(step.changed.id.tolist(), step.changed.label.tolist()))
        expected = fed(range(4))
        self.assert_same(live.snapshot(), expected)
        self.assertEqual([known[i] for i in range(len(expected))], expected.label.tolist())
        self.assertGreater(len(set(known.values())), 1)
        with tempfile.TemporaryDirectory() as folder:
            live.write(folder)
            self.assertEqual(len(accessvdb.read_points_ply(Path(folder) / "points.ply")), len(expected))

    def test_budgets_that_follow_the_clock_give_the_same_again(self):
        live = session(budget_ms=1)
        field = accessvdb.AccessibilityField(
            accessvdb.ToolGeometry.builtin("builtin:pruner"), {"tsdf": {"voxel_size_m": walls.VOXEL_M}}
        )
        only_backlog = 0

        def repeat(step):
            if not step.only_backlog:
                T_W_S = walls.pose(y=0.2 * step.number)
                field.integrate_scan(walls.scan(T_W_S, seed=step.number), T_W_S)
            field.set_budget_points(step.budget_points)
            scored = field.update()
            self.assertEqual(scored.backlog, step.scored.backlog)
            self.assertEqual(scored.backlog_updates, step.scored.backlog_updates)
            self.assert_same(live.snapshot(), field.snapshot())
            status = live.status()
            self.assertEqual(status["backlog"], scored.backlog)
            self.assertEqual(status["backlog_ms"] > 0, scored.backlog > 0)

        for n in range(3):
            self.send(live, n)
            for _ in range(2):
                step = live.step()
                repeat(step)
                only_backlog += step.only_backlog
        live.end_of_poses()
        while (step := live.step()) is not None:
            repeat(step)
            only_backlog += step.only_backlog
        status = live.status()
        self.assertGreater(only_backlog, 3)
        self.assertEqual(status["backlog_steps"], only_backlog)
        self.assertEqual((status["budget_ms"], status["backlog"], status["taken"]), (1, 0, 3))
        self.assertGreater(status["backlog_max"], 300)
        np.testing.assert_array_equal(live.snapshot().label, field.evaluate_from_scratch().label)
        for bad in (-1, 0.5, 60001, float("nan")):
            with self.assertRaises(accessvdb.InvalidArgument) as refused:
                session(budget_ms=bad)
            self.assertIn(refused.exception.id, ("live.budget", "python.value"))

    def test_clouds_in_the_frame_of_the_poses_are_in_the_world(self):
        live = session()
        T_W_S = walls.pose(y=0.5)
        points_W = walls.scan(T_W_S) + T_W_S[:3, 3]
        live.add_scan(stamp(0), points_W, frame="odom")
        live.add_pose(stamp(0), T_W_S[:3, 3], UNTURNED, frame="odom")
        self.assertIsNotNone(live.step())
        field = walls.field(frames=0)
        field.integrate_rays(points_W, T_W_S[None, :3, 3])
        field.update()
        self.assert_same(live.snapshot(), field.snapshot())

    def test_points_are_placed_by_the_pose_at_their_own_time(self):
        # The sensor moves along y by 0.4 m within a scan, of which the second half is measured at its end.
        T_W_S = walls.pose(y=0)
        points = walls.scan(T_W_S)
        times = np.where(np.arange(len(points)) % 2 == 0, 0, 0.1)
        seen = points - np.outer(4 * times, (0, 1, 0)).astype(np.float32)
        results = {}
        for how in ("by times", "off", "unit"):
            live = session(deskew="off" if how == "off" else "auto")
            for ms in range(0, 121, 10):
                live.add_pose(stamp(0) + ms * 1_000_000, (0, 0.004 * ms, 0), UNTURNED)
            unit = {"times": times * 1e3, "time_unit_s": 1e-3} if how == "unit" else {"times": times}
            live.add_scan(stamp(0), seen, **unit)
            step = live.step()
            self.assertEqual(step.by_times, how != "off")
            self.assertEqual(live.status()["by_times"], int(how != "off"))
            results[how] = live.snapshot()
        self.assert_same(results["by times"], results["unit"])
        still = session()
        still.add_scan(stamp(0), points)
        still.add_pose(stamp(0), (0, 0, 0), UNTURNED)
        still.step()
        # As many points as without motion but for what rounding puts beyond the edge of a voxel; smeared, the edges move.
        count = len(still.snapshot())
        self.assertLess(abs(len(results["by times"]) - count), 0.02 * count)
        self.assertGreater(len(results["off"]), 1.03 * count)
        live.add_scan(stamp(1), seen, times=times, time_unit_s=0.3)
        self.assertEqual(live.status()["dropped"]["unusable"], 1)
        with self.assertRaises(accessvdb.InvalidArgument):
            live.add_scan(stamp(2), seen, times=times[:-1])

    def test_several_tools_a_level_world_and_labels_now_and_then(self):
        tool = accessvdb.ToolGeometry.builtin("builtin:pruner")
        params = {"tsdf": {"voxel_size_m": walls.VOXEL_M}}
        both = [accessvdb.ToolSpec(tool, name="flat"), accessvdb.ToolSpec(tool, orientations="sphere:60", name="ball")]
        live = accessvdb.LiveSession(None, params, tools=both, update_every=2, level=(0, 0.1))
        field = accessvdb.AccessibilityField(tools=both, params=params)
        R_L_W = live.R_L_W
        np.testing.assert_allclose(R_L_W @ (-np.sin(0.1), 0, np.cos(0.1)), (0, 0, 1), atol=1e-12)
        for n in range(2):
            T_W_S = walls.pose(y=0.2 * n)
            points = walls.scan(T_W_S, seed=n)
            live.add_scan(stamp(n), points)
            live.add_pose(stamp(n), R_L_W.T @ (0, 0.2 * n, 0), (0, -np.sin(0.05), 0, np.cos(0.05)))
            step = live.step()
            self.assertEqual(len(step.changed) > 0, n == 1)
            field.integrate_scan(points, T_W_S)
        field.update()
        # Turned there and back: all but a few points on the edge of a voxel are the same.
        now, expected = live.snapshot(), field.snapshot()
        self.assertLess(abs(len(now) - len(expected)), 0.01 * len(expected))
        self.assertGreater(np.count_nonzero(now.tools == 2), 0)
        waiting = session(level="imu")
        waiting.add_imu(stamp(0), (0, 0, 9.81), frame="imu")
        self.send(waiting, 0)
        self.assertIsNone(waiting.step())
        self.assertIsNone(waiting.R_L_W)
        waiting.end_of_poses()
        with self.assertRaises(accessvdb.UnusableInput):
            waiting.step()
        with self.assertRaises(TypeError):
            accessvdb.LiveSession(tool, params, tools=both)
        with self.assertRaises(accessvdb.InvalidArgument):
            session(update_every=0)

    def test_transforms_say_where_the_sensor_is(self):
        T_W_S = walls.pose(y=0.5)
        by_frames, by_pose = session(), session()
        by_frames.add_transform("body", "mast", (0, 0.25, 0), UNTURNED)
        by_frames.add_transform("mast", "lidar", (0, 0.25, 0), UNTURNED, stamp(0))
        by_frames.add_transform("lidar", "lidar", (0, 0, 0), UNTURNED)
        by_frames.add_scan(stamp(0), walls.scan(T_W_S), frame="/lidar")
        by_frames.add_pose(stamp(0), (0, 0, 0), UNTURNED, frame="odom", child="body")
        self.assertIsNotNone(by_frames.step())
        by_pose.add_scan(stamp(0), walls.scan(T_W_S))
        by_pose.add_pose(stamp(0), (0, 0.5, 0), UNTURNED)
        self.assertIsNotNone(by_pose.step())
        self.assert_same(by_frames.snapshot(), by_pose.snapshot())
        status = by_frames.status()
        self.assertEqual(status["sensor_chain"], "odom -> body -> mast -> lidar")
        self.assertEqual((status["transforms"], status["transforms_other_parent"]), (3, 1))

    def test_it_can_be_paused_reset_and_relieved_of_a_box(self):
        live = session()
        for n in range(2):
            self.send(live, n)
            live.step()
        live.pause()
        self.send(live, 2)
        self.assertIsNone(live.step())
        live.pause(False)
        self.assertEqual(live.status()["dropped"]["paused"], 1)
        before = len(live.snapshot())
        changed = live.remove_box((-9, -9, -9), (9, 9, 9), "free")
        self.assertGreater(len(changed), before / 2)
        self.assertEqual(np.count_nonzero(live.snapshot().label == 1), 0)
        live.reset()
        self.assertEqual(len(live.snapshot()), 0)
        self.send(live, 0)
        self.assertIsNotNone(live.step())
        self.assert_same(live.snapshot(), fed([0]))
        with self.assertRaises(accessvdb.InvalidArgument):
            live.remove_box((1, 0, 0), (0, 0, 0))

    def test_every_scan_is_accounted_for(self):
        live = session(queue_scans=2)
        sender = threading.Thread(target=lambda: [self.send(live, n) for n in range(30)])
        sender.start()
        taken = []
        while sender.is_alive() or live.wait_for_work(0):
            live.wait_for_work(0.01)
            step = live.step()
            if step is not None:
                taken.append(step.number)
        sender.join()
        status = live.status()
        self.assertEqual(status["published"], 30)
        self.assertEqual(status["taken"], len(taken))
        self.assertEqual(status["taken"], 30)
        # How many were late decides what a blocked point came closest with, but no label.
        now, expected = live.snapshot(), fed(taken)
        np.testing.assert_array_equal(now.position_W, expected.position_W)
        np.testing.assert_array_equal(now.label, expected.label)

    def test_a_map_in_tiles_is_that_of_a_field_and_goes_on(self):
        with tempfile.TemporaryDirectory() as folder:
            tiles = os.path.join(folder, "tiles")
            live = session(rolling=tiles)
            for n in range(4):
                self.send(live, n)
                self.assertIsNotNone(live.step())
            live.checkpoint("four")
            self.assertEqual(live.status()["rolling"]["steps"], 4)
            del live
            live = session(rolling=tiles, resume=True)
            for n in range(4, 8):
                self.send(live, n)
                self.assertIsNotNone(live.step())
            now, expected = live.snapshot(), fed(range(8))
            np.testing.assert_array_equal(now.position_W, expected.position_W)
            np.testing.assert_array_equal(now.label, expected.label)
            live.write(os.path.join(folder, "out"))
            self.assertTrue(os.path.exists(os.path.join(folder, "out", "plan.json")))
            with self.assertRaises(accessvdb.InvalidArgument):
                live.reset()
        live = session()
        self.assertIsNone(live.status()["rolling"])
        with self.assertRaises(accessvdb.InvalidArgument):
            live.checkpoint()

    def test_what_cannot_be_used_is_counted_or_refused(self):
        live = session(memory_limit_bytes=1)
        live.add_pose(stamp(0), (0, float("nan"), 0), UNTURNED)
        live.add_scan(0, np.zeros((1, 3)))
        self.send(live, 0)
        self.send(live, 0)
        live.step()
        status = live.status()
        self.assertEqual(status["poses_invalid"], 1)
        self.assertEqual(status["poses_repeated"], 1)
        self.assertEqual(status["dropped"]["unusable"], 1)
        self.assertEqual(status["dropped"]["out_of_order"], 1)
        self.assertTrue(status["memory_full"])
        live.add_scan(stamp(5), np.ones((3, 3), dtype=np.float32))
        live.end_of_poses()
        self.assertIsNone(live.step())
        self.assertEqual(live.status()["dropped"]["no_pose"], 1)
        for wrong in (lambda: session(queue_scans=0), lambda: session(queue_scans="four"),
                      lambda: session(exclude_box_S=(1, 2)), lambda: live.add_pose(1, (0, 0), UNTURNED),
                      lambda: live.add_pose(1, (0, 0, 0), (0, 0, 1)), lambda: live.add_scan(1, np.zeros((3, 2)))):
            with self.assertRaises(accessvdb.InvalidArgument):
                wrong()


if __name__ == "__main__":
    unittest.main()
