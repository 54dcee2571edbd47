// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// LiveSession: scans and poses from any thread, steps from one.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>

#include "accessvdb/live_session.h"
#include "accessvdb/tool_spec.h"
#include "bindings/arrays.h"
#include "bindings/parts.h"
#include "bindings/settings.h"
#include "bindings/snapshot.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

/// A session whose steps take turns, should several threads call them.
class Session {
 public:
  template <typename Tools>
  Session(const Tools& tools, const FieldParams& params, const LiveOptions& options)
      : session_(tools, params, options) {}

  /// Runs body(session) alone among steps, without the interpreter's lock.
  template <typename Body>
  auto inTurn(const Body& body) {
    return withoutLock([&] {
      const std::scoped_lock turn(turn_);
      return body(session_);
    });
  }
  /// For what may be called at any time.
  template <typename Body>
  auto atOnce(const Body& body) {
    return withoutLock([&] { return body(session_); });
  }

 private:
  std::mutex turn_;
  LiveSession session_;
};

std::unique_ptr<Session> makeSession(const py::object& tool, const py::object& params, const py::object& tools,
                                     const py::object& queue_scans, const py::object& most_poses,
                                     const py::object& memory_limit_bytes, const py::object& T_B_S,
                                     const py::object& exclude_box_S, const py::object& max_gap_s,
                                     const py::object& deskew, const py::object& update_every, const py::object& level,
                                     const std::optional<std::filesystem::path>& rolling, const py::object& resume,
                                     const py::object& budget_ms) {
  requireOneOf(tool, tools);
  const FieldParams given = fieldParamsFrom(params);
  LiveOptions options;
  options.queue_scans = static_cast<std::size_t>(wholeNumberFrom("queue_scans", queue_scans, 0, 1'000'000));
  options.most_poses = static_cast<std::size_t>(wholeNumberFrom("most_poses", most_poses, 0, 100'000'000));
  options.memory_limit_bytes = largeNumberFrom("memory_limit_bytes", memory_limit_bytes);
  options.max_gap_s = numberFrom("max_gap_s", max_gap_s);
  options.deskew = settingFrom<io::Deskew>("deskew", deskew);
  options.update_every = static_cast<std::size_t>(wholeNumberFrom("update_every", update_every, 0, 1'000'000));
  if (!level.is_none()) options.level = levelFrom(level);
  if (rolling) options.rolling = RollingOptions{.folder = *rolling};
  options.resume = boolFrom("resume", resume);
  options.budget_ms = numberFrom("budget_ms", budget_ms);
  if (!T_B_S.is_none()) options.T_B_S = poseOf("T_B_S", T_B_S);
  if (!exclude_box_S.is_none()) {
    const std::vector<double> box = numbers1("exclude_box_S", exclude_box_S, 6);
    options.exclude_box_S =
        Eigen::AlignedBox3d(Eigen::Vector3d(box[0], box[1], box[2]), Eigen::Vector3d(box[3], box[4], box[5]));
  }
  if (tool.is_none()) {
    const std::vector<ToolSpec> specs = toolsFrom(tools);
    return withoutLock([&] { return std::make_unique<Session>(specs, given, options); });
  }
  const auto one = tool.cast<ToolGeometry>();
  return withoutLock([&] { return std::make_unique<Session>(one, given, options); });
}

void addPose(Session& session, std::int64_t stamp_ns, const py::object& p_W, const py::object& q_xyzw,
             const std::string& frame, const std::string& child) {
  LivePose pose;
  pose.stamp_ns = stamp_ns;
  pose.p_W = vector3("p_W", p_W);
  const std::vector<double> q = numbers1("q_xyzw", q_xyzw, 4);
  pose.q_W_B = Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
  pose.frame = frame;
  pose.child = child;
  session.atOnce([&](LiveSession& s) { s.addPose(pose); });
}

void addTransform(Session& session, const std::string& parent, const std::string& child, const py::object& p,
                  const py::object& q_xyzw, std::optional<std::int64_t> stamp_ns) {
  LiveTransform transform;
  transform.stamp_ns = stamp_ns.value_or(0);
  transform.parent = parent;
  transform.child = child;
  transform.p = vector3("p", p);
  const std::vector<double> q = numbers1("q_xyzw", q_xyzw, 4);
  transform.q = Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
  transform.fixed = !stamp_ns;
  session.atOnce([&](LiveSession& s) { s.addTransform(transform); });
}

void addImu(Session& session, std::int64_t stamp_ns, const py::object& force, const std::string& frame) {
  LiveImu imu;
  imu.stamp_ns = stamp_ns;
  imu.force = vector3("force", force);
  imu.frame = frame;
  session.atOnce([&](LiveSession& s) { s.addImu(imu); });
}

void addScan(Session& session, std::int64_t stamp_ns, const py::object& points, const std::string& frame,
             const py::object& times, const py::object& time_unit_s) {
  LiveScan scan;
  scan.stamp_ns = stamp_ns;
  scan.frame = frame;
  const bool doubles =
      py::isinstance<py::array>(points) && points.cast<py::array>().dtype().is(py::dtype::of<double>());
  if (doubles) {
    const Positions given("points", points);
    scan.points_double.assign(given.view().begin(), given.view().end());
  } else {
    const ScanPoints given("points", points, false);
    scan.points.assign(given.view().begin(), given.view().end());
  }
  scan.time_unit_s = numberFrom("time_unit_s", time_unit_s);
  if (!times.is_none()) scan.times = numbers1("times", times, scan.points.size() + scan.points_double.size());
  session.atOnce([&](LiveSession& s) { s.addScan(std::move(scan)); });
}

/// What a step did, with the changed points as columns.
struct Step {
  LiveStep done;
  std::shared_ptr<FieldSnapshot> changed;
};

FieldSnapshot changedIn(const LiveSession& session, std::vector<SurfacePoint> points) {
  return {std::move(points), session.origin_W(), session.params().tsdf.voxel_size_m};
}

std::optional<Step> step(Session& session) {
  return session.inTurn([](LiveSession& s) -> std::optional<Step> {
    std::optional<LiveStep> done = s.step();
    if (!done) return std::nullopt;
    auto changed = keep(changedIn(s, std::move(done->changed)));
    return Step{std::move(*done), std::move(changed)};
  });
}

std::shared_ptr<FieldSnapshot> removeBox(Session& session, const py::object& min_W, const py::object& max_W,
                                         const py::object& removed_as) {
  const Region box = Region::box(vector3("min_W", min_W), vector3("max_W", max_W));
  const auto as = settingFrom<RemovedAs>("removed_as", removed_as);
  return session.inTurn([&](LiveSession& s) { return keep(changedIn(s, s.removeRegion(box, as).changed)); });
}

py::dict status(Session& session) {
  const LiveStatus now = session.atOnce([](LiveSession& s) { return s.status(); });
  py::dict dropped;
  for (int n = 0; n < kNumScanDrops; ++n)
    dropped[name(static_cast<ScanDrop>(n))] = now.dropped[static_cast<std::size_t>(n)];
  py::dict all;
  all["published"] = now.published;
  all["taken"] = now.taken;
  all["late"] = now.late;
  all["waiting"] = now.waiting;
  all["dropped"] = dropped;
  all["poses"] = now.poses;
  all["poses_invalid"] = now.poses_invalid;
  all["poses_repeated"] = now.poses_repeated;
  all["poses_backwards"] = now.poses_backwards;
  all["poses_other_frame"] = now.poses_other_frame;
  all["transforms"] = now.transforms;
  all["transforms_invalid"] = now.transforms_invalid;
  all["transforms_other_parent"] = now.transforms_other_parent;
  all["world_frame"] = now.world_frame;
  all["sensor_chain"] = now.sensor_chain;
  all["unconnected_frame"] = now.unconnected_frame;
  all["unconnected_imu"] = now.unconnected_imu;
  all["waits_for_level"] = now.waits_for_level;
  all["extrinsic_m"] = now.extrinsic_m;
  all["points_in"] = now.points_in;
  all["points_used"] = now.points_used;
  all["by_times"] = now.by_times;
  all["motion"] = now.motion;
  all["excluded_returns"] = now.excluded_returns;
  all["unposed_returns"] = now.unposed_returns;
  all["left_out_returns"] = now.left_out_returns;
  all["surface_points"] = now.surface_points;
  all["memory_bytes"] = now.memory_bytes;
  all["memory_limit_bytes"] = now.memory_limit_bytes;
  all["memory_full"] = now.memory_full;
  all["all_closed"] = now.all_closed;
  all["paused"] = now.paused;
  all["resets"] = now.resets;
  all["rolling"] = now.rolling ? py::object(rollingDict(*now.rolling)) : py::none();
  all["budget_ms"] = now.budget_ms;
  all["budget_points"] = now.budget_points;
  all["backlog"] = now.backlog;
  all["withheld_points"] = now.withheld_points;
  all["backlog_ms"] = now.backlog_ms;
  all["backlog_max"] = now.backlog_max;
  all["backlog_max_ms"] = now.backlog_max_ms;
  all["backlog_steps"] = now.backlog_steps;
  all["latency_p50_ms"] = now.latency_p50_ms;
  all["latency_p99_ms"] = now.latency_p99_ms;
  all["latency_max_ms"] = now.latency_max_ms;
  return all;
}

}  // namespace

void bindLive(py::module_& module) {
  py::class_<Step>(module, "LiveStep", "What LiveSession.step() did.")
      .def_property_readonly("number", [](const Step& s) { return s.done.number; })
      .def_property_readonly("stamp_ns", [](const Step& s) { return s.done.stamp_ns; })
      .def_property_readonly(
          "only_backlog", [](const Step& s) { return s.done.only_backlog; },
          "No scan came: points that waited since this last one or earlier ones were scored, or labels follow what was "
          "lost.")
      .def_property_readonly(
          "budget_points", [](const Step& s) { return s.done.budget_points; },
          "Most points that its update scored, 0: no limit; None if it had no update.")
      .def_property_readonly("fused", [](const Step& s) { return s.done.fused; })
      .def_property_readonly("scored", [](const Step& s) { return s.done.scored; })
      .def_property_readonly("late", [](const Step& s) { return s.done.late; })
      .def_property_readonly("by_times", [](const Step& s) { return s.done.by_times; })
      .def_property_readonly("excluded_returns", [](const Step& s) { return s.done.excluded_returns; })
      .def_property_readonly("unposed_returns", [](const Step& s) { return s.done.unposed_returns; })
      .def_property_readonly("left_out_returns", [](const Step& s) { return s.done.left_out_returns; })
      .def_property_readonly("waited_ms", [](const Step& s) { return s.done.waited_ms; })
      .def_property_readonly("latency_ms", [](const Step& s) { return s.done.latency_ms; })
      .def_property_readonly(
          "changed", [](const Step& s) { return s.changed; },
          "FieldSnapshot of the points that are new, or whose label, reason or direction changed.")
      .def("__repr__", [](const Step& s) {
        return "<accessvdb.LiveStep: scan " + std::to_string(s.done.number) + ", " +
               std::to_string(s.changed->points.size()) + " points changed>";
      });

  py::class_<Session>(module, "LiveSession",
                      "A field that is fed while the scanner runs, by any transport. add_pose(), add_transform(), "
                      "add_imu(), add_scan(), pause(), end_of_poses(), wait_for_work() and status() may be called from "
                      "any thread at any time.")
      .def(py::init(&makeSession), py::arg("tool") = py::none(), py::arg("params") = py::none(), py::kw_only(),
           py::arg("tools") = py::none(), py::arg("queue_scans") = 4, py::arg("most_poses") = 4000,
           py::arg("memory_limit_bytes") = 0, py::arg("T_B_S") = py::none(), py::arg("exclude_box_S") = py::none(),
           py::arg("max_gap_s") = 0.2, py::arg("deskew") = "auto", py::arg("update_every") = 1,
           py::arg("level") = py::none(), py::arg("rolling") = py::none(), py::arg("resume") = false,
           py::arg("budget_ms") = 0,
           "tool, params, tools: as for AccessibilityField. T_B_S: (4, 4), the sensor in the frame whose poses are "
           "given. exclude_box_S: x0, y0, z0, x1, y1, z1 in the sensor's frame. deskew: auto, on or off, of scans with "
           "times. update_every: scans before the next labels. level: roll and pitch of the poses' frame in radians, "
           "or \"imu\". rolling: a folder for the tiles of a map of any extent, as of RollingField; resume: go on "
           "after its "
           "last checkpoint(). budget_ms: the longest that a step should take, 1 .. 60000: so many points are scored "
           "as fit, the others wait; 0: no limit.")
      .def("add_pose", &addPose, py::arg("stamp_ns"), py::arg("p_W"), py::arg("q_xyzw"), py::arg("frame") = "",
           py::arg("child") = "",
           "The pose of the platform at one time. frame, child: the names of the world's frame and of what is posed. "
           "Bad poses are counted, never used.")
      .def("add_transform", &addTransform, py::arg("parent"), py::arg("child"), py::arg("p"), py::arg("q_xyzw"),
           py::arg("stamp_ns") = py::none(),
           "The pose of one frame in another, as tf has them: at one time, or without stamp_ns for good. Bad ones are "
           "counted, never used.")
      .def("add_imu", &addImu, py::arg("stamp_ns"), py::arg("force"), py::arg("frame") = "",
           "What an accelerometer felt, for level=\"imu\": up, at rest, in any unit.")
      .def("add_scan", &addScan, py::arg("stamp_ns"), py::arg("points"), py::arg("frame") = "",
           py::arg("times") = py::none(), py::arg("time_unit_s") = 0,
           "One scan, (N, 3). In the sensor's frame, unless `frame` is that of the poses: then in the world frame. "
           "times: (N,), when each point was measured, in units of time_unit_s since stamp_ns; 0: unit and clock are "
           "told from "
           "the latest scans.")
      .def(
          "pause", [](Session& session, bool paused) { session.atOnce([&](LiveSession& s) { s.pause(paused); }); },
          py::arg("paused") = true, "From now on scans that come are dropped as paused, or taken again.")
      .def(
          "reset", [](Session& session) { session.inTurn([](LiveSession& s) { s.reset(); }); },
          "Forgets the map. Poses, transforms and scans that wait are kept.")
      .def("remove_box", &removeBox, py::arg("min_W"), py::arg("max_W"), py::arg("removed_as") = "unknown",
           "Takes what lies in a box out of the map, as unknown or free, and scores again; what changed.")
      .def_property_readonly(
          "R_L_W",
          [](Session& session) -> std::optional<py::array> {
            const auto R_L_W = session.atOnce([](LiveSession& s) { return s.levelling(); });
            if (!R_L_W) return std::nullopt;
            const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rows = *R_L_W;
            return py::array_t<double>({3, 3}, rows.data());
          },
          "(3, 3): what turns the frame of the poses into that of the map, or None.")
      .def(
          "end_of_poses", [](Session& session) { session.atOnce([](LiveSession& s) { s.endOfPoses(); }); },
          "No more poses will come: scans that wait for some are dropped.")
      .def(
          "wait_for_work",
          [](Session& session, const py::object& at_most_s) {
            const double seconds = std::clamp(numberFrom("at_most_s", at_most_s), 0.0, 86400.0);
            return session.atOnce([&](LiveSession& s) {
              return s.waitForWork(std::chrono::milliseconds(static_cast<std::int64_t>(1000 * seconds)));
            });
          },
          py::arg("at_most_s"), "Waits until step() has something to do, at most so long; whether it has.")
      .def("step", &step,
           "Fuses and scores the oldest scan that has a pose, or scores points that wait: a LiveStep, or None if there "
           "is "
           "nothing to do.")
      .def("status", &status, "What was published, taken, dropped and waits; poses, memory, latency: a dict.")
      .def(
          "snapshot",
          [](Session& session) {
            return session.inTurn([](LiveSession& s) {
              return keep(s.rolling() != nullptr ? s.rolling()->snapshot() : s.field().snapshot());
            });
          },
          "All points with their labels, as of the last step.")
      .def(
          "checkpoint",
          [](Session& session, const std::string& note) {
            session.inTurn([&](LiveSession& s) {
              if (s.rolling() == nullptr)
                throw InvalidArgument("live.rolling", "rolling", "was not given",
                                      "Only maps in tiles have checkpoints");
              s.rolling()->checkpoint(note);
            });
          },
          py::arg("note") = "", "With rolling: as RollingField.checkpoint().")
      .def(
          "write",
          [](Session& session, const std::filesystem::path& folder) {
            session.inTurn([&](LiveSession& s) {
              if (s.rolling() != nullptr) {
                s.rolling()->write(folder);
              } else {
                s.field().write(folder);
              }
            });
          },
          py::arg("folder"),
          "Writes field.vdb, field_points.vdb and points.ply, each whole or not at all; with rolling, a folder of "
          "tiles.");
}

}  // namespace accessvdb::python
