// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// ToolGeometry.
#include "accessvdb/tool_geometry.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tool_tables.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <optional>

#include "bindings/arrays.h"
#include "bindings/parts.h"
#include "bindings/pickles.h"
#include "bindings/settings.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

ToolGeometry fromMesh(const std::filesystem::path& path, const py::object& unit, const py::object& tip,
                      const py::object& axis, const py::object& up) {
  const std::optional<LengthUnit> length_unit = unitFrom(unit);
  ToolPose pose;
  if (!tip.is_none()) pose.tip = vector3("tip", tip);
  pose.axis = vector3("axis", axis);
  pose.up = vector3("up", up);
  return withoutLock([&] { return ToolGeometry::fromMesh(path, length_unit, pose); });
}

/// Triangles are indices: integers that fit, not floats such as 2.0.
std::vector<std::array<std::uint32_t, 3>> trianglesFrom(const py::object& value) {
  const py::array any = py::array::ensure(value);
  if (any && any.ndim() == 2 && any.dtype().kind() == 'f' && any.shape(0) > 0) {
    throw InvalidArgument("python.array", "triangles",
                          "has elements of type " + py::str(any.dtype()).cast<std::string>(),
                          "Pass whole numbers: vertex indices");
  }
  const auto indices = realArray<double>("triangles", value, kAnyNumber, 3);  // exact beyond what 32 bits hold
  std::vector<std::array<std::uint32_t, 3>> triangles(static_cast<std::size_t>(indices.shape(0)));
  const double* next = indices.data();
  for (auto& triangle : triangles) {
    for (std::uint32_t& corner : triangle) {
      const double index = *next++;
      if (!(index >= 0 && index <= std::numeric_limits<std::uint32_t>::max())) {
        throw InvalidArgument("python.value", "triangles", "an index is negative or beyond 32 bits");
      }
      corner = static_cast<std::uint32_t>(index);
    }
  }
  return triangles;
}

ToolGeometry fromTriangles(const py::object& vertices_T, const py::object& triangles, const std::string& name) {
  const ScanPoints vertices("vertices_T", vertices_T, false);
  auto corners = trianglesFrom(triangles);
  return withoutLock([&] {
    return ToolGeometry::fromTriangles({vertices.view().begin(), vertices.view().end()}, std::move(corners), name);
  });
}

void writeTool(PickleWriter& pickle, const ToolGeometry& tool) {
  pickle(tool.vertices_T());
  pickle(tool.triangles());
  pickle(tool.name());
  pickle(tool.notes());
  pickle(tool.watertight());
  pickle(tool.margin_m());
}

ToolGeometry readTool(PickleReader& pickle) {
  std::vector<Eigen::Vector3f> vertices_T;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::string name;
  std::vector<std::string> notes;
  bool watertight = false;
  double margin_m = 0;
  pickle(vertices_T);
  pickle(triangles);
  pickle(name);
  pickle(notes);
  pickle(watertight);
  pickle(margin_m);
  return ToolGeometry::restored(std::move(vertices_T), std::move(triangles), name, std::move(notes), watertight,
                                margin_m);
}

/// All but the tool itself.
template <typename Pickle, typename Spec>
void visitSpec(Pickle& pickle, Spec& spec) {
  auto& [tool, orientations, rolls, name, max_collisions] = spec;
  visitOrientations(pickle, orientations);
  pickle(rolls);
  pickle(name);
  pickle(max_collisions);
}

}  // namespace

void bindTool(py::module_& module) {
  py::class_<ToolGeometry> geometry(
      module, "ToolGeometry",
      "A tool as a triangle mesh: metres, tip at the origin, +x from the tip along the body, +z up.");
  addPickles(geometry, "ToolGeometry", &writeTool, &readTool);
  geometry
      .def_static("from_mesh", &fromMesh, py::arg("path"), py::arg("unit") = py::none(), py::kw_only(),
                  py::arg("tip") = py::none(), py::arg("axis") = py::make_tuple(1, 0, 0),
                  py::arg("up") = py::make_tuple(0, 0, 1),
                  "Reads STL, OBJ, PLY, OFF, DAE, glTF or GLB. tip, axis and up are in the mesh's own units and axes.")
      .def_static("from_triangles", &fromTriangles, py::arg("vertices_T"), py::arg("triangles"),
                  py::arg("name") = "triangles", "From vertices (N, 3) in metres and vertex indices (M, 3).")
      .def_static("builtin", &ToolGeometry::builtin, py::arg("name"), "\"builtin:pencil\" or \"builtin:pruner\".")
      .def_property_readonly(
          "vertices_T",
          [](const py::object& self) {
            const auto& v = self.cast<const ToolGeometry&>().vertices_T();
            return viewInto(self, py::dtype::of<float>(), v.data(), v.size(), sizeof v[0], 3);
          },
          "(N, 3) float32, metres, tool frame, read-only.")
      .def_property_readonly(
          "triangles",
          [](const py::object& self) {
            const auto& t = self.cast<const ToolGeometry&>().triangles();
            return viewInto(self, py::dtype::of<std::uint32_t>(), t.data(), t.size(), sizeof t[0], 3);
          },
          "(M, 3) uint32, vertex indices, read-only.")
      .def(
          "grown_by", &ToolGeometry::grownBy, py::arg("margin_m"),
          "The same tool with everything within a margin of it: where it reaches a point, the tool does with that much "
          "room.")
      .def_property_readonly("margin_m", &ToolGeometry::margin_m, "0: it is not grown.")
      .def_property_readonly("name", &ToolGeometry::name, "File name or builtin name.")
      .def_property_readonly("sha256", &ToolGeometry::sha256, "Of vertices, triangles and margin.")
      .def_property_readonly("notes", &ToolGeometry::notes, "Repairs and oddities, in words.")
      .def_property_readonly("watertight", &ToolGeometry::watertight)
      .def_property_readonly(
          "opening_m", [](const ToolGeometry& t) { return openingWidth_m(t); },
          "Width of the widest opening of its surface: 0 = closed, inf = a sheet. Up to a quarter of its size it is "
          "closed.")
      .def_property_readonly(
          "min_T", [](const ToolGeometry& t) { return arrayOf(t.min_T()); }, "Lowest corner, metres.")
      .def_property_readonly(
          "max_T", [](const ToolGeometry& t) { return arrayOf(t.max_T()); }, "Highest corner, metres.")
      .def_property_readonly("reach_m", &ToolGeometry::reach_m, "Farthest vertex from the tip.")
      .def("__repr__", [](const ToolGeometry& t) {
        return "<accessvdb.ToolGeometry " + t.name() + ": " + std::to_string(t.vertices_T().size()) + " vertices, " +
               std::to_string(t.triangles().size()) + " triangles, reach " + std::to_string(t.reach_m()) + " m>";
      });
  py::class_<ToolSpec> tool_spec(module, "ToolSpec", "One of several tools of a field, and what the field asks of it.");
  addPickles(
      tool_spec, "ToolSpec",
      [](PickleWriter& pickle, const ToolSpec& spec) {
        writeTool(pickle, spec.tool);
        visitSpec(pickle, spec);
      },
      [](PickleReader& pickle) {
        ToolSpec spec{readTool(pickle)};
        visitSpec(pickle, spec);
        return spec;
      });
  tool_spec
      .def(py::init([](const ToolGeometry& tool, const std::string& orientations, int rolls, const std::string& name,
                       int max_collisions) {
             return ToolSpec{tool, OrientationSet::parse(orientations), rolls, name, max_collisions};
           }),
           py::arg("tool"), py::kw_only(), py::arg("orientations") = "yaw", py::arg("rolls") = 0, py::arg("name") = "",
           py::arg("max_collisions") = 0,
           "orientations: as approach.orientations. rolls: 0 = rule. name: letters, digits, _ and -; \"\": from the "
           "tool. max_collisions: 0 = rule, -1 = none.")
      .def_readonly("tool", &ToolSpec::tool, "Its ToolGeometry.")
      .def_property_readonly(
          "orientations", [](const ToolSpec& spec) { return spec.orientations.text(); }, "As text.")
      .def_readonly("rolls", &ToolSpec::rolls, "About its body in each orientation; 0 = rule.")
      .def_readonly("name", &ToolSpec::name, "Its name in the results.")
      .def_readonly("max_collisions", &ToolSpec::max_collisions,
                    "Most collisions of a free direction; 0 = rule, -1 = none.")
      .def("__repr__", [](const ToolSpec& spec) {
        return "<accessvdb.ToolSpec " + spec.name + ": " + spec.tool.name() + ", " + spec.orientations.text() + ">";
      });
  module.def(
      "with_margins",
      [](const py::object& tools, std::vector<double> margins_m) {
        return withMargins(toolsFrom(tools), std::move(margins_m));
      },
      py::arg("tools"), py::arg("margins_m"),
      "Each tool, and behind it the same tool grown by each margin, as tools of a field: its points then have "
      "margin_m, "
      "how much room there is.");
}

}  // namespace accessvdb::python
