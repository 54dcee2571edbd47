// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// RollingField: a field of any extent in bounded memory.
#include "accessvdb/rolling_field.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <memory>
#include <mutex>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "bindings/arrays.h"
#include "bindings/parts.h"
#include "bindings/settings.h"
#include "bindings/snapshot.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

/// Calls from several threads take turns.
class LockedRolling {
 public:
  explicit LockedRolling(RollingField field) : field_(std::move(field)) {}

  /// Runs body(field) alone, without the interpreter's lock.
  template <typename Body>
  auto run(const Body& body) {
    return withoutLock([&] {
      const std::scoped_lock turn(turn_);
      return body(field_);
    });
  }

 private:
  std::mutex turn_;
  RollingField field_;
};

std::unique_ptr<LockedRolling> makeRolling(const py::object& tools, const py::object& params,
                                           const std::filesystem::path& folder, const py::object& memory_limit_bytes,
                                           const py::object& device_limit_bytes, const py::object& tile_voxels,
                                           const py::object& resume) {
  constexpr int kMostVoxels = 1 << 20;
  std::vector<ToolSpec> specs = toolsFrom(tools);
  const FieldParams given = fieldParamsFrom(params);
  if (!given.carry.empty())
    throw InvalidArgument("rolling.params", "params", "carry attributes, which no call brings here", "Leave them out");
  RollingOptions options;
  options.folder = folder;
  options.memory_limit_bytes = largeNumberFrom("memory_limit_bytes", memory_limit_bytes);
  options.device_limit_bytes = largeNumberFrom("device_limit_bytes", device_limit_bytes);
  options.tile_voxels = static_cast<std::int32_t>(wholeNumberFrom("tile_voxels", tile_voxels, 0, kMostVoxels));
  const bool again = boolFrom("resume", resume);
  return withoutLock([&] {
    return std::make_unique<LockedRolling>(again ? RollingField::resume(std::move(specs), given, options)
                                                 : RollingField(std::move(specs), given, options));
  });
}

FrameStats rollScan(LockedRolling& field, const py::object& points_S, const py::object& T_W_S,
                    const py::object& stamp_s) {
  const ScanPoints points("points_S", points_S, true);
  const Eigen::Isometry3d pose = poseOf("T_W_S", T_W_S);
  const double stamp = stampFrom(stamp_s);
  return field.run([&](RollingField& f) { return f.integrateScan(points.view(), pose, stamp); });
}

FrameStats rollRays(LockedRolling& field, const py::object& points_W, const py::object& origins_W,
                    const py::object& stamp_s) {
  const Positions points("points_W", points_W), origins("origins_W", origins_W);
  const double stamp = stampFrom(stamp_s);
  return field.run([&](RollingField& f) { return f.integrateRays(points.view(), origins.view(), stamp); });
}

py::dict rollingStatus(LockedRolling& field) {
  return rollingDict(field.run([](RollingField& f) { return f.status(); }));
}

}  // namespace

py::dict rollingDict(const RollingStatus& now) {
  py::dict all;
  all["steps"] = now.steps;
  all["points"] = now.points;
  all["tile_voxels"] = now.tile_voxels;
  all["margin_voxels"] = now.margin_voxels;
  all["tiles"] = now.tiles;
  all["tiles_in_memory"] = now.tiles_in_memory;
  all["saved"] = now.saved;
  all["loaded"] = now.loaded;
  all["saved_ahead"] = now.saved_ahead;
  all["loaded_ahead"] = now.loaded_ahead;
  all["memory_bytes"] = now.memory_bytes;
  all["device_bytes"] = now.device_bytes;
  all["peak_memory_bytes"] = now.peak_memory_bytes;
  all["unsaved"] = now.unsaved;
  all["memory_short"] = now.memory_short;
  all["fitting_range_m"] = now.fitting_range_m;
  all["left_out_returns"] = now.left_out_returns;
  all["lost_tiles"] = now.lost_tiles;
  return all;
}

void bindRolling(py::module_& module) {
  using R = LockedRolling;
  py::class_<R>(module, "RollingField",
                "A field of any extent in bounded memory, which forgets nothing: tiles that the sensor left go into a "
                "folder and come back with it. After each update() ids, labels, and score and direction of accessible "
                "points are those of one field without a limit.")
      .def(py::init(&makeRolling), py::arg("tools"), py::arg("params") = py::none(), py::kw_only(), py::arg("folder"),
           py::arg("memory_limit_bytes") = 0, py::arg("device_limit_bytes") = 0, py::arg("tile_voxels") = 0,
           py::arg("resume") = false,
           "tools: ToolSpec or ToolGeometry, up to 32. folder: new or empty; with resume that of an earlier field, "
           "which "
           "goes on after its last checkpoint(). The limits are on what the tiles in memory hold; 0 = none, "
           "on a GPU four fifths of what is free there.")
      .def("integrate_scan", &rollScan, py::arg("points_S"), py::arg("T_W_S"), py::kw_only(),
           py::arg("stamp_s") = py::none(), "As AccessibilityField.integrate_scan().")
      .def("integrate_rays", &rollRays, py::arg("points_W"), py::arg("origins_W"), py::kw_only(),
           py::arg("stamp_s") = py::none(), "As AccessibilityField.integrate_rays().")
      .def(
          "update", [](R& field) { return field.run([](RollingField& f) { return f.update(); }); },
          "Scores what changed since the last update().")
      .def(
          "snapshot", [](R& field) { return keep(field.run([](RollingField& f) { return f.snapshot(); })); },
          "All points, also those of tiles that are not in memory.")
      .def("status", &rollingStatus, "Tiles, memory, and what did not fit: a dict.")
      .def(
          "checkpoint",
          [](R& field, const std::string& note) { field.run([&](RollingField& f) { f.checkpoint(note); }); },
          py::arg("note") = "",
          "Saves what changed since the last one: resume goes on from here. note: kept with it, for you.")
      .def_property_readonly(
          "note", [](R& field) { return field.run([](const RollingField& f) { return f.note(); }); },
          "Of the last checkpoint; empty if there is none.")
      .def(
          "write",
          [](R& field, const std::filesystem::path& folder) { field.run([&](RollingField& f) { f.write(folder); }); },
          py::arg("folder"), "Updates, and writes a folder of tiles, as `accessvdb map --tiles` does.");
}

}  // namespace accessvdb::python
