// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Exceptions: each class of accessvdb/error.h becomes the Python class of the same name in accessvdb/_errors.py.
#include <new>

#include "accessvdb/error.h"
#include "bindings/parts.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

const char* className(ErrorCode code) {
  switch (code) {
    case ErrorCode::Usage:
      return "InvalidArgument";
    case ErrorCode::Input:
      return "InputError";
    case ErrorCode::Unusable:
      return "UnusableInput";
    case ErrorCode::Resource:
      return "ResourceLimit";
    case ErrorCode::Device:
      return "DeviceError";
    case ErrorCode::Output:
      return "OutputError";
    case ErrorCode::Internal:
      break;
  }
  return "InternalError";
}

/// External text (a path, for example) need not be UTF-8.
py::str lossyText(const std::string& text) {
  return py::reinterpret_steal<py::str>(
      PyUnicode_DecodeUTF8(text.data(), static_cast<py::ssize_t>(text.size()), "backslashreplace"));
}

void raise(const Error& error) {
  const py::object type = py::module_::import("accessvdb._errors").attr(className(error.code()));
  const py::object exception =
      type(lossyText(error.id()), lossyText(error.subject()), lossyText(error.problem()), lossyText(error.advice()));
  PyErr_SetObject(type.ptr(), exception.ptr());
}

}  // namespace

void bindErrors(py::module_&) {
  // For this module only: exceptions of other modules are left alone.
  py::register_local_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
      raise(error);
    } catch (const std::bad_alloc&) {
      raise(ResourceLimit("memory.exhausted", "", "not enough memory",
                          "Choose a larger voxel size, or free some memory"));
    }
  });
}

}  // namespace accessvdb::python
