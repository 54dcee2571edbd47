// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bindings/columns.h"

namespace py = pybind11;

namespace accessvdb::python {

py::dtype recordType(const std::vector<Column>& columns, std::size_t struct_bytes) {
  py::list names, formats, offsets;
  for (const Column& column : columns) {
    names.append(column.name);
    if (column.components == 1) {
      formats.append(column.type);
    } else {
      formats.append(py::make_tuple(column.type, py::make_tuple(column.components)));
    }
    offsets.append(column.offset_bytes);
  }
  py::dict spec;
  spec["names"] = names;
  spec["formats"] = formats;
  spec["offsets"] = offsets;
  spec["itemsize"] = struct_bytes;
  return py::dtype::from_args(spec);
}

}  // namespace accessvdb::python
