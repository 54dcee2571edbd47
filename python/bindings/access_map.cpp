// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb/access_map.h: what stops the tool in each of its orientations at a point.
#include "accessvdb/access_map.h"

#include <pybind11/numpy.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <string>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/parts.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

/// One row per direction. @param row  writes the columns of an outcome
template <typename Scalar, typename Row>
py::array_t<Scalar> rowsOf(const AccessMap& map, std::size_t columns, const Row& row) {
  py::array_t<Scalar> rows(columns == 1 ? std::vector<std::size_t>{map.directions.size()}
                                        : std::vector<std::size_t>{map.directions.size(), columns});
  Scalar* to = rows.mutable_data();
  for (const DirectionOutcome& outcome : map.directions) {
    row(outcome, to);
    to += columns;
  }
  return rows;
}

}  // namespace

void bindAccessMap(py::module_& module) {
  using M = AccessMap;
  py::class_<M>(module, "AccessMap", "What stops the tool in each of its orientations at one surface point.")
      .def_readonly("point", &M::point, "The SurfacePoint, as of the last update().")
      .def_readonly("collision_limit", &M::collision_limit, "[n_c] Fewest collisions that block a direction.")
      .def_property_readonly(
          "direction_W",
          [](const M& map) {
            return rowsOf<float>(map, 3, [](const DirectionOutcome& o, float* to) {
              for (int axis = 0; axis < 3; ++axis) to[axis] = o.direction_W[axis];
            });
          },
          "(D, 3) float32, unit, outwards along the tool's body; row d is SurfacePoint.direction d.")
      .def_property_readonly(
          "orientation_WT",
          [](const M& map) {
            return rowsOf<float>(map, 4, [](const DirectionOutcome& o, float* to) {
              to[0] = o.orientation_WT.w(), to[1] = o.orientation_WT.x();
              to[2] = o.orientation_WT.y(), to[3] = o.orientation_WT.z();
            });
          },
          "(D, 4) float32, quaternion w, x, y, z, world from tool.")
      .def_property_readonly(
          "reason",
          [](const M& map) {
            return rowsOf<std::uint8_t>(
                map, 1, [](const DirectionOutcome& o, std::uint8_t* to) { *to = static_cast<std::uint8_t>(o.reason); });
          },
          "(D,) uint8, PointReason: what stops this direction; NONE: it is free.")
      .def_property_readonly(
          "score",
          [](const M& map) {
            return rowsOf<std::uint16_t>(map, 1, [](const DirectionOutcome& o, std::uint16_t* to) { *to = o.score; });
          },
          "(D,) uint16, collisions of the tool, or NO_SCORE where it was not tested.")
      .def_property_readonly(
          "roll",
          [](const M& map) {
            return rowsOf<std::uint8_t>(map, 1, [](const DirectionOutcome& o, std::uint8_t* to) { *to = o.roll; });
          },
          "(D,) uint8, index of the roll with the fewest collisions; orientation_WT is that of this roll.")
      .def("__repr__", [](const M& map) {
        return "<accessvdb.AccessMap of point " + std::to_string(map.point.id) + ": " +
               std::to_string(map.reasons()[0]) + " of " + std::to_string(map.directions.size()) + " directions free>";
      });
  module.def(
      "render_access_map",
      [](const std::filesystem::path& png, const M& map) { withoutLock([&] { io::renderAccessMap(png, map); }); },
      py::arg("png"), py::arg("map"),
      "Draws the sphere of directions, from above and from below: a dot for each, coloured by what stops it.");
}

}  // namespace accessvdb::python
