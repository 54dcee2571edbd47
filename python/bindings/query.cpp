// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bindings/query.h"

#include <cmath>
#include <memory>
#include <vector>

#include "accessvdb/batch_query.h"
#include "accessvdb/pose_query.h"
#include "bindings/arrays.h"
#include "bindings/columns.h"
#include "bindings/parts.h"
#include "bindings/settings.h"

namespace py = pybind11;

namespace accessvdb::python {

std::size_t toolFrom(const py::object& tool) {
  const double number = numberFrom("tool", tool);
  if (!(number >= 0 && number < 1e6) || number != std::floor(number))
    throw InvalidArgument("tool.index", "tool", "is not a tool of the field");
  return static_cast<std::size_t>(number);
}
namespace {

struct PointAnswers {
  std::vector<PointAnswer> rows;
};
struct CapsuleAnswers {
  std::vector<CapsuleAnswer> rows;
};
struct FitAnswers {
  std::vector<FitAnswer> rows;
};

/// One bool of each row.
template <typename Rows, typename Is>
py::array_t<bool> boolsOf(const Rows& rows, const Is& is) {
  py::array_t<bool> all(static_cast<py::ssize_t>(rows.size()));
  bool* out = all.mutable_data();
  for (const auto& row : rows) *out++ = is(row);
  return all;
}

/// @param T_WT  [n x 4 x 4]
std::vector<Eigen::Isometry3d> posesFrom(const char* name, const py::object& T_WT) {
  const py::object array = py::isinstance<py::array>(T_WT) ? T_WT : py::object(py::array::ensure(T_WT));
  if (!array) throw InvalidArgument("python.array", name, "is not an array of numbers");
  const py::tuple shape = array.attr("shape");
  if (shape.size() != 3 || shape[1].cast<py::ssize_t>() != 4 || shape[2].cast<py::ssize_t>() != 4) {
    throw InvalidArgument("python.shape", name, "has shape " + py::str(py::object(shape)).cast<std::string>(),
                          "Pass (N, 4, 4), of one pose T[None]");
  }
  const auto rows = realArray<double>(name, array.attr("reshape")(-1, 4), kAnyNumber, 4);
  std::vector<Eigen::Isometry3d> poses(static_cast<std::size_t>(rows.shape(0) / 4));
  for (std::size_t n = 0; n < poses.size(); ++n) {
    poses[n].matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(rows.data() + 16 * n);
    if (poses[n].matrix().row(3) == Eigen::RowVector4d(0, 0, 0, 1)) continue;
    throw UnusableInput("pose.last_row", name, "the last row of pose " + std::to_string(n) + " is not 0 0 0 1",
                        "The position is there in a transposed matrix");
  }
  return poses;
}

std::shared_ptr<FitAnswers> fits(LockedField& field, const py::object& T_WT, const py::object& tool, bool contact) {
  const std::vector<Eigen::Isometry3d> poses = posesFrom("T_WT", T_WT);
  const FitOptions options = {.tool = toolFrom(tool), .contact = contact};
  return field.run([&](AccessibilityField& f) {
    auto answers = std::make_shared<FitAnswers>();
    answers->rows = f.poseQuery().fits(poses, options);
    return answers;
  });
}

PathFitAnswer fitsAlong(LockedField& field, const py::object& T_WT, const py::object& tool, bool unknown_blocks) {
  const std::vector<Eigen::Isometry3d> poses = posesFrom("T_WT", T_WT);
  const PathFitOptions options = {.tool = toolFrom(tool), .unknown_blocks = unknown_blocks};
  return field.run([&](AccessibilityField& f) { return f.poseQuery().fitsAlong(poses, options); });
}

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
        return boolsOf(answers.rows, [](const CapsuleAnswer& answer) { return answer.free(); });
      },
      "(N,) bool, every voxel was seen to be free: valid, no collision, nothing unknown.");
  using F = FitAnswer;
  py::class_<FitAnswers, std::shared_ptr<FitAnswers>> fits(
      module, "FitAnswers", "What a tool meets at the given poses, in their order. Columns are read-only views.");
  addColumns(fits, &FitAnswers::rows,
             {column("collisions", &F::collisions, "(N,) uint32, colliding voxels."),
              column("collision_limit", &F::collision_limit, "(N,) uint32, fewest that block."),
              column("unknown_voxels", &F::unknown_voxels, "(N,) uint32, neither observed nor cleared."),
              column("valid", &F::valid, "(N,) bool, False: no pose, or out of range: nothing was looked at.")});
  fits.def_property_readonly(
          "collision", [](const FitAnswers& a) { return boolsOf(a.rows, [](const F& f) { return f.collision(); }); },
          "(N,) bool, as many collisions as the limit, or not valid.")
      .def_property_readonly(
          "unknown", [](const FitAnswers& a) { return boolsOf(a.rows, [](const F& f) { return f.unknown(); }); },
          "(N,) bool, some voxel was never observed, or not valid.")
      .def_property_readonly(
          "free", [](const FitAnswers& a) { return boolsOf(a.rows, [](const F& f) { return f.free(); }); },
          "(N,) bool, no collision, and all of the tool was seen to be free.");
  py::class_<PathFitAnswer>(module, "PathFit", "What a tool meets on its way from pose to pose.")
      .def_readonly(
          "first_hit", &PathFitAnswer::first_hit,
          "Where it first collides: 1.25 is a quarter of the way from the second pose to the third; else NaN.")
      .def_readonly("fits_until", &PathFitAnswer::fits_until,
                    "The last place that was tried before what ends the way; NaN if that is the first pose.")
      .def_readonly("collision", &PathFitAnswer::collision)
      .def_readonly("unknown", &PathFitAnswer::unknown)
      .def_readonly("valid", &PathFitAnswer::valid)
      .def_property_readonly("free", &PathFitAnswer::free);
}

void bindQueries(py::class_<LockedField>& field) {
  field
      .def("query", &query, py::arg("points_W"),
           "Distance, weight, label, reason and direction at (N, 3) positions in the world frame.")
      .def("query_along", &queryAlong, py::arg("a_W"), py::arg("b_W"), py::arg("radius_m"),
           "What capsules meet: all positions within radius_m of the segments from a_W to b_W, (N, 3) each. radius_m: "
           "one for all, or (N,).")
      .def("fits", &fits, py::arg("T_WT"), py::kw_only(), py::arg("tool") = 0, py::arg("contact") = false,
           "Whether a tool of the field fits at (N, 4, 4) poses, world from tool. contact: its tip touches a surface "
           "point, as where the field scores it.")
      .def("fits_along", &fitsAlong, py::arg("T_WT"), py::kw_only(), py::arg("tool") = 0,
           py::arg("unknown_blocks") = false,
           "The same on the way from each of (N, 4, 4) poses to the next. unknown_blocks: unknown space ends the way, "
           "as "
           "a collision does.");
}

}  // namespace accessvdb::python
