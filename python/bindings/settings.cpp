// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bindings/settings.h"

#include <limits>

#include "accessvdb/error.h"
#include "bindings/arrays.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

[[noreturn]] void throwType(const char* name, const char* wanted, py::handle value) {
  throw InvalidArgument("python.type", name, std::string("needs ") + wanted + ", not " + typeName(value));
}

bool isBool(py::handle value) {
  return PyBool_Check(value.ptr()) || py::isinstance(value, py::module_::import("numpy").attr("bool_"));
}

/// A Python int from anything that claims to be a whole number (int, NumPy's integers), but not from a bool.
py::object indexOf(const char* name, py::handle value) {
  if (isBool(value) || PyIndex_Check(value.ptr()) == 0) throwType(name, "a whole number", value);
  auto number = py::reinterpret_steal<py::object>(PyNumber_Index(value.ptr()));
  if (!number) throw py::error_already_set();
  return number;
}

}  // namespace

double numberFrom(const char* name, py::handle value) {
  if (isBool(value) || PyUnicode_Check(value.ptr())) throwType(name, "a number", value);
  const double number = PyFloat_AsDouble(value.ptr());
  if (number == -1.0 && PyErr_Occurred() != nullptr) {
    PyErr_Clear();
    throwType(name, "a number", value);
  }
  return number;
}

bool boolFrom(const char* name, py::handle value) {
  if (!isBool(value)) throwType(name, "True or False", value);
  return PyObject_IsTrue(value.ptr()) == 1;
}

std::int64_t wholeNumberFrom(const char* name, py::handle value, std::int64_t low, std::int64_t high) {
  const py::object number = indexOf(name, value);
  int overflow = 0;
  const long long got = PyLong_AsLongLongAndOverflow(number.ptr(), &overflow);
  if (overflow != 0 || got < low || got > high) {
    throw InvalidArgument(
        "python.value", name,
        py::str(number).cast<std::string>() + " is outside " + std::to_string(low) + " .. " + std::to_string(high));
  }
  return got;
}

std::uint64_t largeNumberFrom(const char* name, py::handle value) {
  const py::object number = indexOf(name, value);
  const unsigned long long got = PyLong_AsUnsignedLongLong(number.ptr());
  if (PyErr_Occurred() != nullptr) {
    PyErr_Clear();
    throw InvalidArgument("python.value", name,
                          py::str(number).cast<std::string>() + " is outside 0 .. " +
                              std::to_string(std::numeric_limits<std::uint64_t>::max()));
  }
  return got;
}

std::array<double, 3> threeNumbersFrom(const char* name, py::handle value) {
  const Eigen::Vector3d v = vector3(name, py::reinterpret_borrow<py::object>(value));
  return {v[0], v[1], v[2]};
}

OrientationSet orientationsFrom(const char* name, py::handle value) {
  if (py::isinstance<py::str>(value)) return OrientationSet::parse(value.cast<std::string>());
  const auto object = py::reinterpret_borrow<py::object>(value);
  const py::array given = py::array::ensure(object);
  const bool quaternions = given && given.ndim() == 2 && given.shape(1) == 4;
  const auto rows = realArray<double>(name, object, kAnyNumber, quaternions ? 4 : 3);
  std::vector<ToolOrientation> list;
  for (py::ssize_t n = 0; n < rows.shape(0); ++n) {
    list.push_back(quaternions ? orientationOf(rows.at(n, 0), rows.at(n, 1), rows.at(n, 2), rows.at(n, 3))
                               : orientationOf(rows.at(n, 0), rows.at(n, 1), rows.at(n, 2)));
  }
  return OrientationSet::of(std::move(list));
}

std::vector<CarriedAttribute> carryFrom(const char* name, py::handle value) {
  std::vector<CarriedAttribute> carry;
  if (py::isinstance<py::str>(value) || !py::isinstance<py::sequence>(value)) throwType(name, "a list of names", value);
  for (const py::handle each : value) {
    if (!py::isinstance<py::str>(each)) throwType(name, "a list of names", value);
    carry.push_back({each.cast<std::string>(), Keep::Majority});
  }
  return carry;
}

std::size_t wordFrom(const char* name, py::handle value, const char* const* words, std::size_t count) {
  std::string known;
  for (std::size_t n = 0; n < count; ++n) known += (n == 0 ? "\"" : ", \"") + std::string(words[n]) + "\"";
  if (!py::isinstance<py::str>(value)) throwType(name, ("one of " + known).c_str(), value);
  const py::object text = py::reinterpret_borrow<py::object>(value);
  for (std::size_t n = 0; n < count; ++n) {
    if (text.equal(py::str(words[n]))) return n;
  }
  throw InvalidArgument("python.value", name, py::repr(value).cast<std::string>() + " is not one of " + known);
}

void throwNoSuchSetting(const char* class_name, const std::string& name, const std::string& known) {
  throw InvalidArgument("python.setting", std::string(class_name), "has no setting \"" + name + "\"",
                        "Known settings: " + known);
}

void throwNoStruct(const char* class_name, py::handle value) {
  throwType(class_name, "an object of this class or a dict of its settings", value);
}

std::optional<LengthUnit> unitFrom(py::handle value) {
  if (value.is_none()) return std::nullopt;
  return settingFrom<LengthUnit>("unit", value);
}

}  // namespace accessvdb::python
