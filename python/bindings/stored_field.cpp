// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// StoredField: the files written by write() or `accessvdb map`.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <array>
#include <filesystem>
#include <memory>
#include <utility>

#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/tiles.h"
#include "bindings/arrays.h"
#include "bindings/parts.h"
#include "bindings/settings.h"
#include "bindings/snapshot.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

Eigen::Vector3d vectorOf(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

struct StoredTiles {
  tiles::Index index;
  bool allow_changed = false;
};

}  // namespace

void bindStoredField(py::module_& module) {
  using Answer = io::StoredField::Answer;
  py::class_<Answer>(module, "StoredAnswer", "What a stored field knows at one position.")
      .def_property_readonly("position_W", [](const Answer& a) { return arrayOf(a.position_W); })
      .def_readonly("point", &Answer::point, "The surface point of that voxel, else the nearest within 3, else None.")
      .def_readonly("point_distance_m", &Answer::point_distance_m)
      .def_readonly("observed", &Answer::observed)
      .def_readonly("cleared", &Answer::cleared)
      .def_readonly("distance_m", &Answer::distance_m)
      .def_readonly("weight", &Answer::weight);

  using S = io::StoredField;
  py::class_<S, std::shared_ptr<S>>(module, "StoredField", "A field read back from an output folder.")
      .def(py::init([](const std::filesystem::path& folder, const py::object& allow_changed) {
             const bool allow = boolFrom("allow_changed", allow_changed);
             return withoutLock([&] {
               io::OutputCheck check(allow);
               return std::make_shared<S>(S::open(folder, check));
             });
           }),
           py::arg("folder"), py::kw_only(), py::arg("allow_changed") = false,
           "allow_changed: read files that are not as they were written, too; else they raise InputError.")
      .def(
          "at", [](const S& s, const py::object& p_W) { return s.at(vector3("p_W", p_W)); }, py::arg("p_W"),
          "A StoredAnswer for one position in the world frame.")
      .def_property_readonly(
          "points",
          [](const std::shared_ptr<S>& s) {
            // Shares its lifetime with the stored field: no copy. Nothing callable from Python changes a snapshot.
            return std::shared_ptr<FieldSnapshot>(s, const_cast<FieldSnapshot*>(&s->points()));
          },
          "The FieldSnapshot that was written.");

  using T = StoredTiles;
  py::class_<T>(module, "StoredTiles", "A map in tiles read back from its output folder, one tile in memory at a time.")
      .def(py::init([](const std::filesystem::path& folder, const py::object& allow_changed) {
             const bool allow = boolFrom("allow_changed", allow_changed);
             return withoutLock([&] {
               io::OutputCheck check(allow);
               return T{tiles::readIndex(folder, check), allow};
             });
           }),
           py::arg("folder"), py::kw_only(), py::arg("allow_changed") = false,
           "allow_changed: read tiles that are not as they were written, too; else they raise InputError.")
      .def_property_readonly(
          "complete", [](const T& t) { return t.index.complete; }, "Whether every tile is finished.")
      .def_property_readonly("origin_W", [](const T& t) { return arrayOf(vectorOf(t.index.origin_W)); })
      .def_property_readonly("voxel_size_m", [](const T& t) { return t.index.voxel_size_m; })
      .def_property_readonly(
          "folders",
          [](const T& t) {
            std::vector<std::filesystem::path> folders;
            for (const tiles::IndexedTile& tile : t.index.tiles) folders.push_back(tile.folder);
            return folders;
          },
          "Of each tile, with its points.ply, field.vdb and field_points.vdb; StoredField opens one.")
      .def(
          "at",
          [](const T& t, const py::object& p_W) {
            const Eigen::Vector3d position_W = vector3("p_W", p_W);
            return withoutLock([&] {
              io::OutputCheck check(t.allow_changed);
              return tiles::answersAt(t.index, {&position_W, 1}, check).front().field;
            });
          },
          py::arg("p_W"), "A StoredAnswer for one position in the world frame.")
      .def(
          "overview",
          [](const T& t, std::uint64_t most) {
            return withoutLock([&] { return keep(tiles::overview(t.index, most, t.allow_changed)); });
          },
          py::arg("most"), "A FieldSnapshot of all tiles, evenly thinned to about `most` points.");

  module.def(
      "read_points_ply",
      [](const std::filesystem::path& path) { return withoutLock([&] { return keep(io::readPointsPly(path)); }); },
      py::arg("path"), "Reads points.ply back as a FieldSnapshot.");
}

}  // namespace accessvdb::python
