// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where to go first, where to look next, how far a tool can turn, and how far the next obstacle is.
#include "accessvdb/approaches.h"

#include <pybind11/stl.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "accessvdb/distance_field.h"
#include "accessvdb/next_views.h"
#include "bindings/arrays.h"
#include "bindings/parts.h"
#include "bindings/query.h"
#include "bindings/settings.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

std::size_t wholeFrom(const char* name, const py::object& value) {
  const double number = numberFrom(name, value);
  if (!(number >= 0 && number < 1e9) || number != std::floor(number))
    throw InvalidArgument("python.value", name, "is not a whole number of 0 or more");
  return static_cast<std::size_t>(number);
}

DistanceGrid gridOf(LockedField& field, const py::object& low_W, const py::object& high_W, const py::object& most_m) {
  const Eigen::Vector3d low = vector3("low_W", low_W), high = vector3("high_W", high_W);
  const double most = numberFrom("most_m", most_m);
  return field.run([&](AccessibilityField& f) { return distanceGrid(f, low, high, most); });
}

py::array_t<float> arcsOf(LockedField& field, const std::vector<std::uint32_t>& ids, const py::object& tool) {
  const std::size_t k = toolFrom(tool);
  const std::vector<float> arcs_deg = field.run([&](AccessibilityField& f) { return f.freeArcs_deg(ids, k); });
  return py::array_t<float>(static_cast<py::ssize_t>(arcs_deg.size()), arcs_deg.data());
}

py::object approachesOf(LockedField& field, const py::object& most, const py::object& spacing_m, const py::object& each,
                        const py::object& stand_off_m, const py::object& from_W, const py::object& within_m,
                        const std::string& per, bool allow_unknown) {
  ApproachOptions options;
  options.most = wholeFrom("most", most);
  options.spacing_m = numberFrom("spacing_m", spacing_m);
  options.each = wholeFrom("each", each);
  options.stand_off_m = numberFrom("stand_off_m", stand_off_m);
  if (!from_W.is_none()) options.from_W = vector3("from_W", from_W);
  options.within_m = numberFrom("within_m", within_m);
  options.per = per;
  options.allow_unknown = allow_unknown;
  const std::string text = field.run([&](AccessibilityField& f) {
    std::vector<std::string> tools;
    for (const ToolSpec& tool : f.tools()) tools.push_back(tool.name);
    return io::approachesJson(approaches(f, options), tools);
  });
  return py::module_::import("json").attr("loads")(text);
}

py::object viewsOf(LockedField& field, const py::object& most, const py::object& azimuth_deg,
                   const py::object& elevation_deg, const std::vector<double>& pitches_deg, const py::object& rays,
                   const py::object& max_range_m, const py::object& body_radius_m, const py::object& from_W,
                   const py::object& within_m, const py::object& travel_m) {
  constexpr double kRadians = M_PI / 180;
  ViewOptions options;
  options.most = wholeFrom("most", most);
  options.sensor.azimuth_rad = numberFrom("azimuth_deg", azimuth_deg) * kRadians;
  if (!py::isinstance<py::sequence>(elevation_deg) || py::len(elevation_deg) != 2)
    throw InvalidArgument("python.value", "elevation_deg", "is not two angles, the lower one first");
  options.sensor.elevation_min_rad = numberFrom("elevation_deg", elevation_deg[py::int_(0)]) * kRadians;
  options.sensor.elevation_max_rad = numberFrom("elevation_deg", elevation_deg[py::int_(1)]) * kRadians;
  options.sensor.pitches_rad.clear();
  for (const double pitch_deg : pitches_deg) options.sensor.pitches_rad.push_back(pitch_deg * kRadians);
  options.sensor.rays = numberFrom("rays", rays);
  options.sensor.max_range_m = numberFrom("max_range_m", max_range_m);
  options.body_radius_m = numberFrom("body_radius_m", body_radius_m);
  if (!from_W.is_none()) options.from_W = vector3("from_W", from_W);
  options.within_m = numberFrom("within_m", within_m);
  options.travel_m = numberFrom("travel_m", travel_m);
  const std::string text = field.run([&](AccessibilityField& f) { return io::viewsJson(nextViews(f, options)); });
  return py::module_::import("json").attr("loads")(text);
}

/// Of a grid of (X, Y, Z).
template <typename Scalar>
py::array arrayIn(const py::object& self, const std::vector<Scalar>& values) {
  const auto& grid = self.cast<const DistanceGrid&>();
  const auto X = static_cast<py::ssize_t>(grid.size[0]), Y = static_cast<py::ssize_t>(grid.size[1]),
             Z = static_cast<py::ssize_t>(grid.size[2]), size = static_cast<py::ssize_t>(sizeof(Scalar));
  py::array array(py::dtype::of<Scalar>(), {X, Y, Z}, {Y * Z * size, Z * size, size}, values.data(), self);
  array.attr("flags").attr("writeable") = false;
  return array;
}

}  // namespace

void bindDistanceGrid(py::module_& module) {
  py::class_<DistanceGrid>(module, "DistanceGrid", "Distances to the nearest obstacle from the voxels of a box.")
      .def_property_readonly(
          "distance_m",
          [](const py::object& self) { return arrayIn(self, self.cast<const DistanceGrid&>().distance_m); },
          "(X, Y, Z) float32, metres to the nearest voxel that collides, at most most_m; read-only.")
      .def_property_readonly(
          "known", [](const py::object& self) { return arrayIn(self, self.cast<const DistanceGrid&>().known); },
          "(X, Y, Z) uint8, 1: observed or cleared; where it is 0, an obstacle may be anywhere; read-only.")
      .def_property_readonly(
          "first_W", [](const DistanceGrid& grid) { return arrayOf(grid.first_W); },
          "(3,) centre of the first voxel, world frame, metres.")
      .def_readonly("voxel_size_m", &DistanceGrid::voxel_size_m)
      .def_readonly("most_m", &DistanceGrid::most_m);
}

void bindApproaches(py::class_<LockedField>& field) {
  field
      .def("distance_grid", &gridOf, py::arg("low_W"), py::arg("high_W"), py::arg("most_m"),
           "Exact distances beyond tau: from each voxel of a box to the nearest one that collides, up to most_m.")
      .def("free_arcs_deg", &arcsOf, py::arg("ids"), py::kw_only(), py::arg("tool") = 0,
           "How far the tool can turn from its best direction at each point and stay free, degrees; -1: it does not "
           "reach it.")
      .def("approaches", &approachesOf, py::kw_only(), py::arg("most") = 10, py::arg("spacing_m") = 0.0,
           py::arg("each") = 3, py::arg("stand_off_m") = 0.0, py::arg("from_W") = py::none(),
           py::arg("within_m") = std::numeric_limits<double>::infinity(), py::arg("per") = "",
           py::arg("allow_unknown") = false,
           "Where to go first, and how: the content of approaches.json. Targets are spread over what the tool reaches, "
           "the best first, each with poses before contact, at contact and to retreat to.")
      .def("views", &viewsOf, py::kw_only(), py::arg("most") = 5, py::arg("azimuth_deg") = 360.0,
           py::arg("elevation_deg") = py::make_tuple(-7.0, 52.0), py::arg("pitches_deg") = std::vector<double>{0},
           py::arg("rays") = 200000, py::arg("max_range_m") = std::numeric_limits<double>::infinity(),
           py::arg("body_radius_m") = 0.0, py::arg("from_W") = py::none(),
           py::arg("within_m") = std::numeric_limits<double>::infinity(), py::arg("travel_m") = 0.0,
           "Where to look next: the content of views.json. Poses of the sensor (world from sensor, x forward, z up) "
           "from which points would resolve that were seen too rarely, from the wrong side, or with unknown space "
           "before them; never one at which the body is not known to be free.");
}

}  // namespace accessvdb::python
