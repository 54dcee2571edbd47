// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bindings/snapshot.h"

#include <algorithm>
#include <array>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/columns.h"
#include "bindings/parts.h"
#include "bindings/pickles.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

std::vector<Column> pointColumns() {
  using P = SurfacePoint;
  return {
      column("id", &P::id, "(N,) uint32, stable over the life of the field."),
      column("position_W", &P::position_W, "(N, 3) float64, first return in its voxel, metres."),
      column("normal_W", &P::normal_W, "(N, 3) float32, unit; zero where there is none."),
      column("direction_W", &P::direction_W,
             "(N, 3) float32, unit, outwards along the tool's body; the tool travels along -direction_W."),
      column("yaw_rad", &P::yaw_rad, "(N,) float32, of direction_W."),
      column("direction", &P::direction, "(N,) uint16, index of the best direction, or NO_DIRECTION."),
      column("roll", &P::roll, "(N,) uint8, index of the best roll in that direction."),
      column("tool", &P::tool,
             "(N,) uint8, of several tools: the first that reaches the point, else the one that came closest."),
      column("tools", &P::tools, "(N,) uint32, of several tools: bit k is set if tool k reaches the point."),
      column("margin_m", &P::margin_m,
             "(N,) float32, of a field with_margins(): the largest with which the tool still reaches the point; -1: "
             "none."),
      column("access_probability", &P::access_probability,
             "(N,) float32, how likely the exact tool reaches the point, [0, 1]; -1: nothing is said."),
      column("score", &P::score, "(N,) uint16, fewest collisions of any direction, or NO_SCORE."),
      column("weight", &P::weight, "(N,) float32, [w] observations behind the confidence."),
      column("confidence", &P::confidence, "(N,) float32, [c] in [0, 1)."),
      column("stability", &P::stability, "(N,) float32, [a] in [0, 1]."),
      column("label", &P::label, "(N,) uint8, PointLabel."),
      column("reason", &P::reason, "(N,) uint8, PointReason."),
      column("confident", &P::confident, "(N,) bool, accessible and confidence times stability above stability_min."),
  };
}

/// By name, so that a new field does not compile before it has a place here.
template <typename Pickle, typename Point>
void visitPoint(Pickle& pickle, Point& point) {
  auto& [id, position_W, normal_W, direction_W, yaw_rad, direction, roll, tool, tools, margin_m, free_arc_deg, score,
         weight, confidence, stability, access_probability, label, reason, confident, orientation_WT] = point;
  const auto visit = [&](auto&... fields) { (pickle(fields), ...); };
  visit(id, position_W, normal_W, direction_W, yaw_rad, direction, roll, tool, tools, margin_m, free_arc_deg, score,
        weight, confidence, stability, access_probability, label, reason, confident, orientation_WT.coeffs());
}

template <typename Pickle, typename Snapshot>
void visitSnapshot(Pickle& pickle, Snapshot& snapshot) {
  auto& [points, origin_W, voxel_size_m, attributes] = snapshot;
  pickle.each(points, [&](auto& point) { visitPoint(pickle, point); });
  pickle(origin_W);
  pickle(voxel_size_m);
  pickle.each(attributes, [&](auto& column) {
    auto& [name, values] = column;
    pickle(name);
    pickle(values);
  });
}

/// How the tool is held, world from tool.
std::array<float, 4> wxyz(const SurfacePoint& p) {
  return {p.orientation_WT.w(), p.orientation_WT.x(), p.orientation_WT.y(), p.orientation_WT.z()};
}

py::array_t<float> orientations(const FieldSnapshot& snapshot) {
  py::array_t<float> rows({snapshot.points.size(), std::size_t{4}});
  float* to = rows.mutable_data();
  for (const SurfacePoint& point : snapshot.points) {
    const std::array<float, 4> row = wxyz(point);
    to = std::copy_n(row.data(), 4, to);
  }
  return rows;
}

py::dict labelCounts(const FieldSnapshot& snapshot) {
  py::dict counts;
  for (int n = 0; n < kNumPointLabels; ++n) {
    counts[name(static_cast<PointLabel>(n))] = snapshot.count(static_cast<PointLabel>(n));
  }
  return counts;
}

py::dict reasonCounts(const FieldSnapshot& snapshot) {
  py::dict counts;
  const auto reasons = snapshot.reasons();
  for (int n = 0; n < kNumPointReasons; ++n) {
    counts[name(static_cast<PointReason>(n))] = reasons[static_cast<std::size_t>(n)];
  }
  return counts;
}

template <typename Enum>
py::object enumMember(const char* class_name, Enum value) {
  return py::module_::import("accessvdb").attr(class_name)(static_cast<int>(value));
}

void bindSurfacePoint(py::module_& module) {
  using P = SurfacePoint;
  py::class_<P>(module, "SurfacePoint", "One surface point.")
      .def_readonly("id", &P::id)
      .def_property_readonly("position_W", [](const P& p) { return arrayOf(p.position_W); })
      .def_property_readonly("normal_W", [](const P& p) { return arrayOf(p.normal_W); })
      .def_property_readonly("direction_W", [](const P& p) { return arrayOf(p.direction_W); })
      .def_readonly("yaw_rad", &P::yaw_rad)
      .def_property_readonly("orientation_WT", [](const P& p) { return py::array_t<float>(4, wxyz(p).data()); })
      .def_readonly("direction", &P::direction)
      .def_readonly("roll", &P::roll)
      .def_readonly("tool", &P::tool)
      .def_readonly("tools", &P::tools)
      .def_readonly("margin_m", &P::margin_m)
      .def_readonly("access_probability", &P::access_probability)
      .def_readonly("score", &P::score)
      .def_readonly("weight", &P::weight)
      .def_readonly("confidence", &P::confidence)
      .def_readonly("stability", &P::stability)
      .def_property_readonly("label", [](const P& p) { return enumMember("PointLabel", p.label); })
      .def_property_readonly("reason", [](const P& p) { return enumMember("PointReason", p.reason); })
      .def_readonly("confident", &P::confident)
      .def("__repr__", [](const P& p) {
        return "<accessvdb.SurfacePoint " + std::to_string(p.id) + ": " + name(p.label) + ", reason " + name(p.reason) +
               ">";
      });
}

}  // namespace

std::shared_ptr<FieldSnapshot> keep(FieldSnapshot&& snapshot) {
  return std::make_shared<FieldSnapshot>(std::move(snapshot));
}

void bindSnapshot(py::module_& module) {
  bindSurfacePoint(module);
  py::class_<FieldSnapshot, std::shared_ptr<FieldSnapshot>> snapshot(
      module, "FieldSnapshot",
      "All surface points at one moment, in the order of their ids. Columns are read-only views without a copy; they "
      "keep the snapshot alive, and it is independent of its field.");
  addColumns(snapshot, &FieldSnapshot::points, pointColumns());
  addPickles(
      snapshot, "FieldSnapshot", [](PickleWriter& pickle, const FieldSnapshot& self) { visitSnapshot(pickle, self); },
      [](PickleReader& pickle) {
        FieldSnapshot made;
        visitSnapshot(pickle, made);
        return made;
      });
  snapshot
      .def_property_readonly(
          "origin_W", [](const FieldSnapshot& s) { return arrayOf(s.origin_W); },
          "World position of the map's local origin.")
      .def_readonly("voxel_size_m", &FieldSnapshot::voxel_size_m)
      .def_property_readonly("orientation_WT", &orientations,
                             "(N, 4) float32, a copy: quaternion w, x, y, z, world from tool, in the best direction; "
                             "1, 0, 0, 0 where there is none.")
      .def_property_readonly(
          "attributes",
          [](const py::object& self) {
            py::dict columns;
            for (const AttributeColumn& column : self.cast<const FieldSnapshot&>().attributes) {
              columns[py::str(column.name)] = viewInto(self, py::dtype::of<std::int32_t>(), column.values.data(),
                                                       column.values.size(), sizeof(std::int32_t), 1);
            }
            return columns;
          },
          "What the returns carried (FieldParams.carry): {name: (N,) int32, read-only}; NO_ATTRIBUTE where there is "
          "none.")
      .def_property_readonly("counts", &labelCounts, "Number of points per label: {\"accessible\": 12, ...}.")
      .def_property_readonly("reasons", &reasonCounts, "Number of points per reason: {\"tool\": 12, ...}.")
      .def("__repr__", [](const FieldSnapshot& s) {
        return "<accessvdb.FieldSnapshot: " + std::to_string(s.points.size()) + " points, " +
               std::to_string(s.count(PointLabel::Accessible)) + " accessible, " +
               std::to_string(s.count(PointLabel::Blocked)) + " blocked>";
      });
}

}  // namespace accessvdb::python
