// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// AccessibilityField and what its calls return.
#include "accessvdb/accessibility_field.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/field_export.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/scan_io.h"
#include "bindings/arrays.h"
#include "bindings/locked_field.h"
#include "bindings/parts.h"
#include "bindings/query.h"
#include "bindings/regions.h"
#include "bindings/settings.h"
#include "bindings/snapshot.h"

namespace py = pybind11;

namespace accessvdb::python {

template <>
inline constexpr std::array kWords<io::Compression> = {"auto", "blosc", "zip", "none"};
template <>
inline constexpr std::array kWords<io::UpAxis> = {"z", "y"};

double stampFrom(const py::object& stamp_s) {
  return stamp_s.is_none() ? std::numeric_limits<double>::quiet_NaN() : numberFrom("stamp_s", stamp_s);
}

std::vector<ToolSpec> toolsFrom(const py::object& tools) {
  std::vector<ToolSpec> specs;
  for (const py::handle each : tools) {
    if (py::isinstance<ToolGeometry>(each)) {
      specs.push_back({each.cast<ToolGeometry>(), {}, 0, {}, 0});
    } else if (py::isinstance<ToolSpec>(each)) {
      specs.push_back(each.cast<ToolSpec>());
    } else {
      throw py::type_error("tools holds something that is neither a ToolSpec nor a ToolGeometry");
    }
  }
  return specs;
}

void requireOneOf(const py::object& tool, const py::object& tools) {
  if (tool.is_none() == tools.is_none()) throw py::type_error("give either tool or tools");
  if (!tool.is_none() && !py::isinstance<ToolGeometry>(tool)) throw py::type_error("tool is not a ToolGeometry");
}

namespace {

void bindReports(py::module_& module) {
  using F = FrameStats;
  py::class_<F>(module, "FrameStats", "What one scan did.")
      .def_readonly("points_in", &F::points_in)
      .def_readonly("points_used", &F::points_used)
      .def_property_readonly(
          "dropped",
          [](const F& stats) {
            py::dict dropped;
            for (int n = 0; n < kNumDropReasons; ++n) {
              dropped[name(static_cast<DropReason>(n))] = stats.dropped[static_cast<std::size_t>(n)];
            }
            return dropped;
          },
          "Number of unused returns by reason: {\"no_return\": 12, ...}.")
      .def_readonly("touched_leaves", &F::touched_leaves)
      .def_readonly("new_leaves", &F::new_leaves)
      .def_readonly("distance_updates", &F::distance_updates)
      .def_readonly("cleared_updates", &F::cleared_updates)
      .def_readonly("integrate_ms", &F::integrate_ms)
      .def_readonly("mirror_ms", &F::mirror_ms)
      .def_readonly("changed_leaves", &F::changed_leaves)
      .def_readonly("flipped_voxels", &F::flipped_voxels)
      .def_readonly("contradicted_platforms", &F::contradicted_platforms)
      .def_readonly("mirror_bytes", &F::mirror_bytes)
      .def_readonly("fused_on_device", &F::fused_on_device, "Whether a GPU fused it, and the host follows.")
      .def_readonly("surface_points", &F::surface_points)
      .def("__repr__", [](const F& stats) {
        return "<accessvdb.FrameStats: " + std::to_string(stats.points_used) + " of " +
               std::to_string(stats.points_in) + " points used>";
      });

  using U = UpdateStats;
  py::class_<U>(module, "UpdateStats", "What one update did.")
      .def_readonly("dirty_points", &U::dirty_points)
      .def_readonly("moved_points", &U::moved_points)
      .def_readonly("backlog_updates", &U::backlog_updates)
      .def_readonly("withheld_points", &U::withheld_points)
      .def_readonly("scored_points", &U::scored_points)
      .def_readonly("direction_tests", &U::direction_tests)
      .def_readonly("backlog", &U::backlog)
      .def_readonly("label_changes", &U::label_changes)
      .def_readonly("update_ms", &U::update_ms)
      .def_readonly("score_ms", &U::score_ms)
      .def("__repr__", [](const U& stats) {
        return "<accessvdb.UpdateStats: " + std::to_string(stats.scored_points) + " points scored, " +
               std::to_string(stats.label_changes) + " labels changed>";
      });

  using M = MemoryUse;
  py::class_<M>(module, "MemoryUse", "Bytes by owner.")
      .def_readonly("map_bytes", &M::map_bytes)
      .def_readonly("mirror_bytes", &M::mirror_bytes)
      .def_readonly("point_host_bytes", &M::point_host_bytes)
      .def_readonly("point_device_bytes", &M::point_device_bytes)
      .def_readonly("device_peak_bytes", &M::device_peak_bytes)
      .def_readonly("leaves", &M::leaves)
      .def_readonly("active_voxels", &M::active_voxels);
}

/// A ticket whose waiting leaves the interpreter to other threads, also when Python destroys it.
class WaitingTicket {
 public:
  explicit WaitingTicket(UpdateTicket ticket) : ticket_(std::move(ticket)) {}
  ~WaitingTicket() {
    withoutLock([this] { ticket_ = UpdateTicket(); });
  }
  WaitingTicket(WaitingTicket&&) noexcept = default;
  WaitingTicket& operator=(WaitingTicket&&) noexcept = default;
  WaitingTicket(const WaitingTicket&) = delete;
  WaitingTicket& operator=(const WaitingTicket&) = delete;

  [[nodiscard]] UpdateStats wait() const {
    return withoutLock([this] { return ticket_.wait(); });
  }
  [[nodiscard]] bool done() const { return ticket_.done(); }

 private:
  UpdateTicket ticket_;
};

void bindTicket(py::module_& module) {
  using T = WaitingTicket;
  py::class_<T>(module, "UpdateTicket",
                "An update that may still be running; other Python threads can run while one waits for it. It keeps "
                "the outcome even if the field is gone.")
      .def("wait", &T::wait, "Waits until the update has ended: its UpdateStats, or what it raised.")
      .def_property_readonly("done", &T::done, "Whether wait() would return or raise at once.")
      .def("__repr__", [](const T& ticket) {
        return std::string("<accessvdb.UpdateTicket: ") + (ticket.done() ? "done>" : "running>");
      });
}

std::unique_ptr<LockedField> makeField(const py::object& tool, const py::object& params, const py::object& tools) {
  requireOneOf(tool, tools);
  const FieldParams given = fieldParamsFrom(params);
  if (tool.is_none()) {
    std::vector<ToolSpec> specs = toolsFrom(tools);
    return withoutLock([&] { return std::make_unique<LockedField>(std::move(specs), given); });
  }
  const auto one = tool.cast<ToolGeometry>();
  return withoutLock([&] { return std::make_unique<LockedField>(one, given); });
}

std::unique_ptr<LockedField> loadState(const std::filesystem::path& file, const py::object& tool,
                                       const py::object& tools, const py::object& backend, const py::object& threads,
                                       const py::object& fuse_on_host, const py::object& device_cache_bytes) {
  requireOneOf(tool, tools);
  FieldParams place;
  place.backend = settingFrom<BackendKind>("backend", backend);
  place.threads = settingFrom<int>("threads", threads);
  place.fuse_on_host = settingFrom<bool>("fuse_on_host", fuse_on_host);
  place.device_cache_bytes = settingFrom<std::uint64_t>("device_cache_bytes", device_cache_bytes);
  std::vector<ToolSpec> specs;
  if (tool.is_none()) specs = toolsFrom(tools);
  const auto one = tool.is_none() ? std::nullopt : std::optional(tool.cast<ToolGeometry>());
  return withoutLock([&] {
    if (one) specs = onlyTool(*one, inspectState(file).params);
    return std::make_unique<LockedField>(AccessibilityField::loadState(file, std::move(specs), place));
  });
}

/// Rows of whole numbers of 32 bits, one for each return, or one number for each. None: nothing.
std::vector<std::int32_t> attributesFrom(const py::object& attributes) {
  if (attributes.is_none()) return {};
  const py::array given = py::array::ensure(attributes);
  if (!given || given.ndim() < 1 || given.ndim() > 2 || (given.dtype().kind() != 'i' && given.dtype().kind() != 'u')) {
    throw InvalidArgument("python.type", "attributes", "is no array of whole numbers, (N,) or (N, attributes)",
                          "Convert it with astype(numpy.int32)");
  }
  const auto wide = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>(given);
  std::vector<std::int32_t> values(static_cast<std::size_t>(wide.size()));
  for (std::size_t n = 0; n < values.size(); ++n) {
    const std::int64_t value = wide.data()[n];
    if (value < std::numeric_limits<std::int32_t>::min() || value > std::numeric_limits<std::int32_t>::max()) {
      throw InvalidArgument("python.value", "attributes", std::to_string(value) + " does not fit into 32 bits");
    }
    values[n] = static_cast<std::int32_t>(value);
  }
  return values;
}

FrameStats integrateScan(LockedField& field, const py::object& points_S, const py::object& T_W_S,
                         const py::object& stamp_s, const py::object& attributes) {
  const ScanPoints points("points_S", points_S, true);
  const Eigen::Isometry3d pose = poseOf("T_W_S", T_W_S);
  const double stamp = stampFrom(stamp_s);
  const std::vector<std::int32_t> values = attributesFrom(attributes);
  return field.run([&](AccessibilityField& f) { return f.integrateScan(points.view(), pose, stamp, values); });
}

FrameStats integrateRays(LockedField& field, const py::object& points_W, const py::object& origins_W,
                         const py::object& stamp_s, const py::object& attributes) {
  const Positions points("points_W", points_W), origins("origins_W", origins_W);
  const double stamp = stampFrom(stamp_s);
  const std::vector<std::int32_t> values = attributesFrom(attributes);
  return field.run(
      [&](AccessibilityField& f) { return f.integrateRays(points.view(), origins.view(), stamp, values); });
}

FrameStats integrateRecord(LockedField& field, const io::ScanRecord& record) {
  return field.run([&](AccessibilityField& f) {
    const double stamp_s = record.stamp_s != 0 ? record.stamp_s : std::numeric_limits<double>::quiet_NaN();
    return record.points_W.empty() ? f.integrateScan(record.points_S, record.T_W_S, stamp_s, record.attributes)
                                   : f.integrateRays(record.points_W, record.origins_W, stamp_s, record.attributes);
  });
}

template <auto kWrite>
void writeTo(LockedField& field, const std::filesystem::path& path, const py::object& half_float,
             const py::object& compression, const py::object& up_axis, const py::object& surface) {
  const io::WriteOptions options = {.half_float = boolFrom("half_float", half_float),
                                    .compression = settingFrom<io::Compression>("compression", compression),
                                    .up_axis = settingFrom<io::UpAxis>("up_axis", up_axis),
                                    .surface = boolFrom("surface", surface)};
  field.run([&](AccessibilityField& f) { kWrite(f, path, options); });
}

}  // namespace

void bindField(py::module_& module) {
  bindReports(module);
  bindTicket(module);
  using F = LockedField;
  py::class_<F> class_(
      module, "AccessibilityField",
      "Scans go in, labelled surface points come out. Calls from several threads take turns; other Python "
      "threads can run during long calls.");
  bindQueries(class_);
  bindApproaches(class_);
  bindRegionCalls(class_);
  class_
      .def(
          py::init(&makeField), py::arg("tool") = py::none(), py::arg("params") = py::none(), py::kw_only(),
          py::arg("tools") = py::none(),
          "params: FieldParams, or a dict of its fields: {\"tsdf\": {\"voxel_size_m\": 0.02}}. tools: instead of tool, "
          "up to 32 ToolSpec or ToolGeometry over one map; each tool's result is that of a field with it alone.")
      .def("integrate_scan", &integrateScan, py::arg("points_S"), py::arg("T_W_S"), py::kw_only(),
           py::arg("stamp_s") = py::none(), py::arg("attributes") = py::none(),
           "Fuses one scan. points_S: (N, 3) in the sensor frame, metres; exactly (0, 0, 0) means no return. T_W_S: "
           "(4, 4) pose, sensor to world. Bad returns are counted, never used. stamp_s: time of the first return, in "
           "seconds of any clock. attributes: what the returns carry, (N,) or (N, len(params.carry)) whole numbers, "
           "NO_ATTRIBUTE for none.")
      .def("integrate_rays", &integrateRays, py::arg("points_W"), py::arg("origins_W"), py::kw_only(),
           py::arg("stamp_s") = py::none(), py::arg("attributes") = py::none(),
           "Fuses rays: (N, 3) returns and (N, 3) or (1, 3) sensor positions, all in the world frame. stamp_s: time of "
           "the first return. attributes: as for integrate_scan().")
      .def(
          "attributes_at",
          [](F& f, const py::object& p_W) {
            const Eigen::Vector3d at = vector3("p_W", p_W);
            return f.run([&](AccessibilityField& field) {
              std::map<std::string, std::int32_t> values;
              const std::vector<std::int32_t> found = field.attributesAt(at);
              for (std::size_t n = 0; n < found.size(); ++n) values[field.params().carry[n].name] = found[n];
              return values;
            });
          },
          py::arg("p_W"), "What the returns in the voxel there carried: {name: value}; empty if there is no point.")
      .def_property_readonly(
          "latest_stamp_s", [](F& f) { return f.run([](AccessibilityField& field) { return field.latestStamp_s(); }); },
          "The latest stamp of a scan; None while none had one.")
      .def("integrate", &integrateRecord, py::arg("record"), "Fuses a record of a ScanSequence.")
      .def(
          "update", [](F& f) { return f.run([](AccessibilityField& field) { return field.update(); }); },
          "Scores what changed since the last update().")
      .def(
          "set_budget_points",
          [](F& f, const py::object& points) {
            const auto most = static_cast<int>(wholeNumberFrom("points", points, 0, 2'000'000'000));
            f.run([&](AccessibilityField& field) { field.setBudgetPoints(most); });
          },
          py::arg("points"),
          "Most points that each update scores from now on, for each tool; 0: no limit, and the next one scores all "
          "that wait.")
      .def(
          "update_async",
          [](F& f) { return WaitingTicket(f.run([](AccessibilityField& field) { return field.updateAsync(); })); },
          "Begins update() on a thread of its own and returns an UpdateTicket. The next scan may be fused meanwhile; "
          "other calls wait. Errors come from the ticket's wait().")
      .def(
          "snapshot", [](F& f) { return f.run([](AccessibilityField& field) { return keep(field.snapshot()); }); },
          "All points with their labels, as of the last update().")
      .def(
          "evaluate_from_scratch",
          [](F& f) { return f.run([](AccessibilityField& field) { return keep(field.evaluateFromScratch()); }); },
          "The same points scored again from scratch against the current map; changes nothing.")
      .def(
          "point_at",
          [](F& f, const py::object& p_W) {
            const Eigen::Vector3d position = vector3("p_W", p_W);
            return f.run([&](AccessibilityField& field) { return field.pointAt(position); });
          },
          py::arg("p_W"), "The SurfacePoint in the voxel that contains p_W, or None.")
      .def(
          "access_map",
          [](F& f, const py::object& p_W, std::size_t tool) {
            const Eigen::Vector3d position = vector3("p_W", p_W);
            return f.run([&](AccessibilityField& field) { return field.accessMap(position, tool); });
          },
          py::arg("p_W"), py::arg("tool") = 0,
          "Why that point is as it is: an AccessMap with every orientation tried by itself; None if there is no point. "
          "tool: index of one of several.")
      .def(
          "tool_snapshot",
          [](F& f, std::size_t tool) {
            return f.run([&](AccessibilityField& field) { return field.toolSnapshot(tool); });
          },
          py::arg("tool"), "The points of snapshot() as a field with that one of several tools alone would have them.")
      .def("write", &writeTo<&writeField>, py::arg("folder"), py::kw_only(), py::arg("half_float") = false,
           py::arg("compression") = "auto", py::arg("up_axis") = "z", py::arg("surface") = false,
           "Writes field.vdb, field_points.vdb and points.ply, each whole or not at all.")
      .def("write_frame", &writeTo<&writeFieldFrame>, py::arg("file"), py::kw_only(), py::arg("half_float") = false,
           py::arg("compression") = "auto", py::arg("up_axis") = "z", py::arg("surface") = false,
           "Writes field.vdb under a name of your choice: one frame of a sequence while a map grows.")
      .def(
          "save_state",
          [](F& f, const std::filesystem::path& file) {
            f.run([&](AccessibilityField& field) { field.saveState(file); });
          },
          py::arg("file"),
          "Writes all that later scans and updates depend on into one file, whole or not at all. load_state() goes on "
          "from it.")
      .def_static("load_state", &loadState, py::arg("file"), py::arg("tool") = py::none(), py::kw_only(),
                  py::arg("tools") = py::none(), py::arg("backend") = "auto", py::arg("threads") = 0,
                  py::arg("fuse_on_host") = false, py::arg("device_cache_bytes") = 0,
                  "A field that goes on where the saved one was, with its parameters: before its first update(), with "
                  "the same bits as without the stop; after one, with the same labels. tool, or tools: those of the "
                  "saved field.")
      .def(
          "memory_use", [](F& f) { return f.run([](AccessibilityField& field) { return field.memoryUse(); }); },
          "Bytes by owner.")
      .def_property_readonly(
          "tool", [](const F& f) { return f.constants().tool(); }, "The tool; of several the first.")
      .def_property_readonly(
          "tools", [](const F& f) { return f.constants().tools(); }, "List of ToolSpec: all tools, with their names.")
      .def_property_readonly(
          "params", [](const F& f) { return f.constants().params(); }, "A copy of the parameters, every rule applied.")
      .def_property_readonly(
          "origin_W", [](F& f) { return arrayOf(f.run([](AccessibilityField& field) { return field.origin_W(); })); },
          "World position of the map's local origin; set by the first scan.")
      .def_property_readonly(
          "device_name", [](F& f) { return f.run([](AccessibilityField& field) { return field.deviceName(); }); },
          "\"cpu\" or \"cuda:NAME\".")
      .def_property_readonly(
          "device_note", [](F& f) { return f.run([](AccessibilityField& field) { return field.deviceNote(); }); },
          "Why backend \"auto\" is not on a GPU; else empty.")
      .def_property_readonly(
          "tool_share_hidden",
          [](F& f) { return f.run([](AccessibilityField& field) { return field.toolShareHidden(); }); },
          "The largest share of a tool, turned in any way, that is inside the self-exclusion radius; above 0.5 labels "
          "say "
          "little.")
      .def_property_readonly(
          "collision_limit",
          [](F& f) { return f.run([](AccessibilityField& field) { return field.collisionLimit(); }); },
          "[n_c] Fewest collisions that block a direction.");
}

}  // namespace accessvdb::python
