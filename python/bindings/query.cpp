// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bindings/query.h"

#include <memory>
#include <vector>

#include "accessvdb/batch_query.h"
#include "bindings/arrays.h"
#include "bindings/columns.h"
#include "bindings/parts.h"
#include "bindings/settings.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

struct PointAnswers {
  std::vector<PointAnswer> rows;
};
struct CapsuleAnswers {
  std::vector<CapsuleAnswer> rows;
};

std::vector<Column> pointColumns() {
  using A = PointAnswer;
  return {
      column("distance_m", &A::distance_m,
             "(N,) float32, the voxel's mean of the clamped distances; NaN where unobserved."),
      column("point_distance_m", &A::point_distance_m,
             "(N,) float32, distance to the surface point that answers, or NaN."),
      column("direction_W", &A::direction_W, "(N, 3) float32, its best direction; zero where there is none."),
      column("point_id", &A::point_id, "(N,) uint32, the id of the surface point that answers, or NO_POINT."),
      column("weight", &A::weight, "(N,) uint16, observations of the voxel; 0 = unobserved."),
      column("direction", &A::direction, "(N,) uint16, index of the best direction, or NO_DIRECTION."),
      column("score", &A::score, "(N,) uint16, fewest collisions of any direction, or NO_SCORE."),
      column("label", &A::label, "(N,) uint8, PointLabel."),
      column("reason", &A::reason, "(N,) uint8, PointReason."),
      column("unknown", &A::unknown, "(N,) bool, neither observed nor cleared, or a bad position."),
      column("cleared", &A::cleared, "(N,) bool, a ray passed the voxel on its way to a return."),
  };
}

std::vector<Column> capsuleColumns() {
  using A = CapsuleAnswer;
  return {
      column("min_distance_m", &A::min_distance_m, "(N,) float32, from the axis to the nearest surface, or NaN."),
      column("first_hit_t", &A::first_hit_t, "(N,) float32, where along the axis, 0 .. 1, it first collides, or NaN."),
      column("collision", &A::collision, "(N,) bool, a surface is nearer than the radius."),
      column("unknown", &A::unknown, "(N,) bool, some voxel was never observed, or the capsule was not examined."),
      column("valid", &A::valid, "(N,) bool, False: bad numbers or too large, not examined."),
  };
}

std::shared_ptr<PointAnswers> query(LockedField& field, const py::object& points_W) {
  const Positions positions("points_W", points_W);
  return field.run([&](AccessibilityField& f) {
    auto answers = std::make_shared<PointAnswers>();
    answers->rows.resize(positions.view().size());
    f.batchQuery().at(positions.view(), answers->rows);
    return answers;
  });
}

/// One radius for all, or one per capsule.
std::vector<double> radiiFrom(const py::object& radius_m, std::size_t count) {
  if (py::isinstance<py::float_>(radius_m) || PyIndex_Check(radius_m.ptr()) != 0) {
    return std::vector<double>(count, numberFrom("radius_m", radius_m));
  }
  return numbers1("radius_m", radius_m, count);
}

std::shared_ptr<CapsuleAnswers> queryAlong(LockedField& field, const py::object& a_W, const py::object& b_W,
                                           const py::object& radius_m) {
  const Positions a("a_W", a_W), b("b_W", b_W);
  const std::size_t count = a.view().size();
  if (b.view().size() != count) {
    throw InvalidArgument("python.shape", "b_W",
                          "has " + std::to_string(b.view().size()) + " rows but a_W " + std::to_string(count));
  }
  const std::vector<double> radii = radiiFrom(radius_m, count);
  return field.run([&](AccessibilityField& f) {
    std::vector<CapsuleQuery> capsules(count);
    for (std::size_t n = 0; n < count; ++n) capsules[n] = {a.view()[n], b.view()[n], radii[n]};
    auto answers = std::make_shared<CapsuleAnswers>();
    answers->rows.resize(count);
    f.batchQuery().along(capsules, answers->rows);
    return answers;
  });
}

}  // namespace

void bindAnswers(py::module_& module) {
  module.attr("NO_POINT") = kNoPoint;
  py::class_<PointAnswers, std::shared_ptr<PointAnswers>> points(
      module, "PointAnswers",
      "What a field knows at the given positions, in their order. Columns are read-only views.");
  addColumns(points, &PointAnswers::rows, pointColumns());
  py::class_<CapsuleAnswers, std::shared_ptr<CapsuleAnswers>> capsules(
      module, "CapsuleAnswers", "What the given capsules meet, in their order. Columns are read-only views.");
  addColumns(capsules, &CapsuleAnswers::rows, capsuleColumns());
  capsules.def_property_readonly(
      "free",
      [](const CapsuleAnswers& answers) {
        py::array_t<bool> free(static_cast<py::ssize_t>(answers.rows.size()));
        bool* out = free.mutable_data();
        for (const CapsuleAnswer& answer : answers.rows) *out++ = answer.free();
        return free;
      },
      "(N,) bool, every voxel was seen to be free: valid, no collision, nothing unknown.");
}

void bindQueries(py::class_<LockedField>& field) {
  field
      .def("query", &query, py::arg("points_W"),
           "Distance, weight, label, reason and direction at (N, 3) positions in the world frame.")
      .def("query_along", &queryAlong, py::arg("a_W"), py::arg("b_W"), py::arg("radius_m"),
           "What capsules meet: all positions within radius_m of the segments from a_W to b_W, (N, 3) each. radius_m: "
           "one for all, or (N,).");
}

}  // namespace accessvdb::python
