// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PointLabel and PointReason as enum.IntEnum, so that they compare with the numbers in arrays.
#include <algorithm>
#include <cctype>
#include <string>

#include "accessvdb/attributes.h"
#include "accessvdb/point_label.h"
#include "bindings/parts.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

template <typename Enum>
void addEnum(py::module_& module, const char* class_name, int count, const char* doc) {
  py::list members;
  for (int n = 0; n < count; ++n) {
    std::string upper = name(static_cast<Enum>(n));
    std::transform(upper.begin(), upper.end(), upper.begin(), [](unsigned char c) { return std::toupper(c); });
    members.append(py::make_tuple(upper, n));
  }
  const py::object made =
      py::module_::import("enum").attr("IntEnum")(class_name, members, py::arg("module") = "accessvdb");
  made.attr("__doc__") = doc;
  module.attr(class_name) = made;
}

}  // namespace

void bindLabels(py::module_& module) {
  addEnum<PointLabel>(module, "PointLabel", kNumPointLabels, "What a surface point is.");
  addEnum<PointReason>(module, "PointReason", kNumPointReasons,
                       "Why a point is not accessible: the stage at which the direction that came closest failed.");
  module.attr("NO_SCORE") = kNoScore;
  module.attr("NO_ATTRIBUTE") = kNoAttribute;
  module.attr("NO_DIRECTION") = kNoDirection;
}

}  // namespace accessvdb::python
