// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bindings/arrays.h"

#include <algorithm>
#include <cstdint>

namespace py = pybind11;

namespace accessvdb::python {
namespace {

// Rows of three numbers are read as Eigen's vectors in place.
static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float) && alignof(Eigen::Vector3f) == alignof(float));
static_assert(sizeof(Eigen::Vector3d) == 3 * sizeof(double) && alignof(Eigen::Vector3d) == alignof(double));

std::string shapeText(const py::array& array) {
  std::string text = "(";
  for (py::ssize_t axis = 0; axis < array.ndim(); ++axis) {
    text += std::to_string(array.shape(axis)) + (axis + 1 < array.ndim() ? ", " : array.ndim() == 1 ? "," : "");
  }
  return text + ")";
}

std::string expectedShape(py::ssize_t rows, py::ssize_t columns) {
  return "(" + (rows == kAnyNumber ? "N" : std::to_string(rows)) + ", " + std::to_string(columns) + ")";
}

/// Any array-like as an array of real numbers, of unchanged shape.
py::array numbers(const char* name, const py::object& value) {
  if (value.is_none()) throw InvalidArgument("python.array", name, "is None", "Pass a NumPy array");
  // Text would become an array of characters, and a dict one of objects: name what was passed, not what NumPy made of
  // it.
  if (py::isinstance<py::str>(value) || py::isinstance<py::bytes>(value) || py::isinstance<py::dict>(value)) {
    throw InvalidArgument("python.array", name, "is of type " + typeName(value), "Pass a NumPy array of numbers");
  }
  py::array array = py::array::ensure(value);
  if (!array) {
    throw InvalidArgument("python.array", name,
                          "is of type " + typeName(value) + ", which NumPy cannot convert to an array",
                          "Pass a NumPy array of numbers");
  }
  const char kind = array.dtype().kind();
  if (kind != 'f' && kind != 'i' && kind != 'u') {
    throw InvalidArgument("python.array", name,
                          "has elements of type " + py::str(array.dtype()).cast<std::string>() +
                              (kind == 'O' ? " (rows of different lengths, perhaps)" : ""),
                          "Pass an array of float32 or float64");
  }
  // A mask marks numbers that are not data; reading on without it would treat them as data.
  if (py::hasattr(value, "mask") && py::isinstance(value, py::module_::import("numpy.ma").attr("MaskedArray"))) {
    throw InvalidArgument("python.array", name, "is a masked array",
                          "Pass its valid rows: a.compressed(), a[~mask].data");
  }
  return array;
}

template <typename Scalar>
bool isOfType(const py::array& array) {
  return py::isinstance<py::array_t<Scalar>>(array);
}

template <typename Scalar>
std::span<const Eigen::Matrix<Scalar, 3, 1>> rows(const py::array_t<Scalar, py::array::c_style>& array) {
  using Vector = Eigen::Matrix<Scalar, 3, 1>;
  return {reinterpret_cast<const Vector*>(array.data()), static_cast<std::size_t>(array.shape(0))};
}

}  // namespace

std::string typeName(py::handle value) {
  const py::handle type = py::type::handle_of(value);
  const auto module = py::str(type.attr("__module__")).cast<std::string>();
  const auto name = py::str(type.attr("__qualname__")).cast<std::string>();
  return module == "builtins" ? name : module + "." + name;
}

template <typename Scalar>
py::array_t<Scalar, py::array::c_style> realArray(const char* name, const py::object& value, py::ssize_t row_count,
                                                  py::ssize_t columns) {
  const py::array array = numbers(name, value);
  if (array.ndim() != 2 || array.shape(1) != columns || (row_count != kAnyNumber && array.shape(0) != row_count)) {
    const bool more_columns = array.ndim() == 2 && row_count == kAnyNumber && array.shape(1) > columns;
    throw InvalidArgument("python.shape", name,
                          "has shape " + shapeText(array) + " instead of " + expectedShape(row_count, columns),
                          more_columns ? "Pass the columns x, y, z alone: a[:, :3]" : "");
  }
  auto converted = py::array_t<Scalar, py::array::c_style | py::array::forcecast>::ensure(array);
  if (!converted) throw py::error_already_set();
  return py::reinterpret_borrow<py::array_t<Scalar, py::array::c_style>>(converted);
}
template py::array_t<float, py::array::c_style> realArray(const char*, const py::object&, py::ssize_t, py::ssize_t);
template py::array_t<double, py::array::c_style> realArray(const char*, const py::object&, py::ssize_t, py::ssize_t);

ScanPoints::ScanPoints(const char* name, const py::object& value, bool or_none) {
  if (or_none && py::len_hint(value) == 0 && numbers(name, value).ndim() == 1) return;
  if (py::isinstance<py::array>(value) && isOfType<float>(value)) {
    const auto array = realArray<float>(name, value, kAnyNumber, 3);
    view_ = rows(array);
    keep_ = array;
    return;
  }
  // Rounded here, not by NumPy, which warns about numbers beyond float32; they become infinite, and are dropped and
  // counted.
  const auto array = realArray<double>(name, value, kAnyNumber, 3);
  const auto given = rows(array);
  const py::gil_scoped_release released;
  rounded_.reserve(given.size());
  for (const Eigen::Vector3d& p : given) rounded_.push_back(p.cast<float>());
  view_ = rounded_;
}

Positions::Positions(const char* name, const py::object& value) {
  const auto array = realArray<double>(name, value, kAnyNumber, 3);
  view_ = rows(array);
  keep_ = array;
}

std::vector<double> numbers1(const char* name, const py::object& value, std::size_t count) {
  const py::array array = numbers(name, value);
  if (array.ndim() != 1 || static_cast<std::size_t>(array.shape(0)) != count) {
    throw InvalidArgument("python.shape", name,
                          "has shape " + shapeText(array) + " instead of (" + std::to_string(count) + ",)");
  }
  const auto converted = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(array);
  if (!converted) throw py::error_already_set();
  return {converted.data(), converted.data() + count};
}

Eigen::Vector3d vector3(const char* name, const py::object& value) {
  const std::vector<double> xyz = numbers1(name, value, 3);
  return {xyz[0], xyz[1], xyz[2]};
}

Eigen::Isometry3d poseOf(const char* name, const py::object& value) {
  const auto array = realArray<double>(name, value, 4, 4);
  Eigen::Isometry3d pose;
  pose.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(array.data());
  if (pose.matrix().row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
    if (!pose.matrix().allFinite()) {
      throw UnusableInput("pose.last_row", name, "the pose is not finite", "Leave out scans whose pose is not known");
    }
    throw UnusableInput("pose.last_row", name, "the last row of a pose is not 0 0 0 1",
                        "The position is there in a transposed matrix");
  }
  return pose;
}

py::array_t<double> arrayOf(const Eigen::Vector3d& v) { return py::array_t<double>(3, v.data()); }
py::array_t<float> arrayOf(const Eigen::Vector3f& v) { return py::array_t<float>(3, v.data()); }

py::array viewInto(const py::object& owner, const py::dtype& type, const void* first, std::size_t count,
                   std::size_t stride, int components) {
  std::vector<py::ssize_t> shape = {static_cast<py::ssize_t>(count)};
  std::vector<py::ssize_t> strides = {static_cast<py::ssize_t>(stride)};
  if (components > 1) {
    shape.push_back(components);
    strides.push_back(type.itemsize());
  }
  py::array array(type, std::move(shape), std::move(strides), first, owner);
  array.attr("setflags")(py::arg("write") = false);  // for good: NumPy restores it only if the owner allows it
  return array;
}

}  // namespace accessvdb::python
