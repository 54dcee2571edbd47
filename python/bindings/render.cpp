// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pictures without a display.
#include "accessvdb/render.h"

#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <string>

#include "accessvdb/error.h"
#include "accessvdb/tool_geometry.h"
#include "bindings/arrays.h"
#include "bindings/parts.h"
#include "bindings/settings.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

io::RenderOptions optionsFrom(const py::object& width_px, const py::object& height_px, const py::object& view_W) {
  constexpr std::int64_t kMost = 1 << 15;
  return {.width_px = static_cast<int>(wholeNumberFrom("width_px", width_px, 1, kMost)),
          .height_px = static_cast<int>(wholeNumberFrom("height_px", height_px, 1, kMost)),
          .view_W = vector3("view_W", view_W)};
}

io::RenderColour colourFrom(const std::string& word) {
  if (word == "label") return io::RenderColour::Label;
  if (word == "reason") return io::RenderColour::Reason;
  throw InvalidArgument("python.colour", "colour", "\"" + word + "\" is not known", "Use 'label' or 'reason'");
}

}  // namespace

void bindRender(py::module_& module) {
  module.def(
      "render_field",
      [](const std::filesystem::path& png, const FieldSnapshot& snapshot, const py::object& width_px,
         const py::object& height_px, const py::object& view_W, const std::string& colour) {
        io::RenderOptions options = optionsFrom(width_px, height_px, view_W);
        options.colour = colourFrom(colour);
        withoutLock([&] { io::renderField(png, snapshot, options); });
      },
      py::arg("png"), py::arg("snapshot"), py::kw_only(), py::arg("width_px") = 1600, py::arg("height_px") = 1000,
      py::arg("view_W") = py::make_tuple(-1.0, -1.0, 0.8), py::arg("colour") = "label",
      "Draws the points. view_W: towards the viewer. colour: 'label' (green accessible, red blocked, grey not scored) "
      "or 'reason' (why a point is not accessible).");
  module.def(
      "render_tool",
      [](const std::filesystem::path& png, const ToolGeometry& tool, const py::object& width_px,
         const py::object& height_px, const py::object& view_W) {
        const io::RenderOptions options = optionsFrom(width_px, height_px, view_W);
        withoutLock([&] { io::renderTool(png, tool, options); });
      },
      py::arg("png"), py::arg("tool"), py::kw_only(), py::arg("width_px") = 1600, py::arg("height_px") = 1000,
      py::arg("view_W") = py::make_tuple(-1.0, -1.0, 0.8),
      "Draws the tool in its frame from four sides, its tip and axes marked.");
}

}  // namespace accessvdb::python
