// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb/params.h: the same structs, fields and defaults.
#include "accessvdb/params.h"

#include <tuple>
#include <type_traits>
#include <utility>

#include "accessvdb/params_rows.h"
#include "bindings/parts.h"
#include "bindings/pickles.h"
#include "bindings/settings.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

std::function<FieldParams(py::handle)>& fieldParamsConverter() {
  static std::function<FieldParams(py::handle)> converter;
  return converter;
}

/// Row by row, also those that Python does not show.
template <typename Pickle, typename Params>
void visitParams(Pickle& pickle, Params& params) {
  forEachRow<std::remove_const_t<Params>>([&]<typename Row>(const Row&) {
    auto& value = params.*Row::member;
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (ParamStruct<Value>) {
      visitParams(pickle, value);
    } else if constexpr (Row::template is<&ApproachParams::orientations>) {
      visitOrientations(pickle, value);
    } else if constexpr (Row::template is<&FieldParams::origin_W>) {
      pickle.each(value, [&](auto& origin_W) { pickle(origin_W); });
    } else if constexpr (Row::template is<&FieldParams::window>) {
      pickle.each(value, [&](auto& window) {
        auto& [core_low, core_high] = window;
        pickle(core_low);
        pickle(core_high);
      });
    } else if constexpr (Row::template is<&FieldParams::carry>) {
      pickle.each(value, [&](auto& attribute) {
        auto& [name, keep] = attribute;
        pickle(name);
        pickle(keep);
      });
    } else {
      pickle(value);
    }
  });
}

/// A class with a setting for each row of the struct.
/// @param inner  classes of the structs inside this one
template <ParamStruct Params, typename... Inner>
SettingsClass<Params> paramsClass(py::module_& m, const char* name, const char* doc,
                                  const SettingsClass<Inner>&... inner) {
  SettingsClass<Params> c(m, name, doc);
  const std::tuple<const SettingsClass<Inner>&...> classes(inner...);
  forEachRow<Params>([&]<typename Row>(const Row& row) {
    using Value = std::remove_cvref_t<decltype(std::declval<Params&>().*Row::member)>;
    if constexpr (ParamStruct<Value>) {
      c.nested(row.name, Row::member, std::get<const SettingsClass<Value>&>(classes), row.words);
    } else if constexpr (!Row::template is<&FieldParams::origin_W> && !Row::template is<&FieldParams::window>) {
      c.field(row.name, Row::member, row.words);  // tiles of a larger map are made by programs in C++
    }
  });
  addPickles(
      c.pythonClass(), name, [](PickleWriter& pickle, const Params& params) { visitParams(pickle, params); },
      [](PickleReader& pickle) {
        Params made;
        visitParams(pickle, made);
        return made;
      });
  return c;
}

}  // namespace

FieldParams fieldParamsFrom(py::handle value) { return fieldParamsConverter()(value); }

void bindParams(py::module_& m) {
  const auto projective =
      paramsClass<ProjectiveParams>(m, "ProjectiveParams", "The projective baseline, for evaluation only.");
  const auto tsdf = paramsClass<TsdfParams>(
      m, "TsdfParams", "How scans are fused into the truncated signed distance field.", projective);
  const auto approach = paramsClass<ApproachParams>(m, "ApproachParams", "Which approach directions are admissible.");
  const auto scoring =
      paramsClass<ScoringParams>(m, "ScoringParams", "How a direction is scored and a point labelled.");
  const auto update = paramsClass<UpdateParams>(m, "UpdateParams", "When points are scored again.");
  const auto change = paramsClass<ChangeParams>(m, "ChangeParams", "How the map follows a world that changes.");
  auto c = paramsClass<FieldParams>(m, "FieldParams", "Everything that an AccessibilityField needs besides the tool.",
                                    tsdf, approach, scoring, update, change);
  c.pythonClass()
      .def_static(
          "paper",
          [](const py::object& voxel_size_m) { return FieldParams::paper(numberFrom("voxel_size_m", voxel_size_m)); },
          py::arg("voxel_size_m"), "The paper's own constants, for its tables.")
      .def("resolved", &FieldParams::resolved, "Copy with every rule applied. Raises InvalidArgument for a bad value.")
      .def("describe", &FieldParams::describe, "Every effective value as \"name value\", one per line.");
  fieldParamsConverter() = c.converter();
}

}  // namespace accessvdb::python
