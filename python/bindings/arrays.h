// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Checked input from Python: arrays of points and poses, and calls that run without the interpreter's lock.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <exception>
#include <new>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/export.h"

namespace accessvdb::python {

/// "list", "numpy.ndarray": the name for a user's value in a message.
std::string typeName(pybind11::handle value);

/// A C-contiguous array from an array-like of real numbers, [n x 3] or [rows x columns]; copied only if type,
/// byte order or layout differs.
/// @param name  the argument's, for messages
/// @throws InvalidArgument "python.array" if it is not an array of real numbers, or is masked;
///         "python.shape" for another shape
template <typename Scalar>
pybind11::array_t<Scalar, pybind11::array::c_style> realArray(const char* name, const pybind11::object& value,
                                                              pybind11::ssize_t rows, pybind11::ssize_t columns);
inline constexpr pybind11::ssize_t kAnyNumber = -1;  ///< any number of rows

/// Points in the frame of a scan: [n x 3], float32 read in place, other types rounded to it.
class ACCESSVDB_PRIVATE ScanPoints {
 public:
  /// @param or_none  [] is taken, too: no points. It has no columns that could be wrong.
  ScanPoints(const char* name, const pybind11::object& value, bool or_none);
  [[nodiscard]] std::span<const Eigen::Vector3f> view() const { return view_; }

 private:
  pybind11::object keep_;  // the array that view_ looks into
  std::vector<Eigen::Vector3f> rounded_;
  std::span<const Eigen::Vector3f> view_;
};

/// Positions in the world frame: [n x 3] as float64.
class ACCESSVDB_PRIVATE Positions {
 public:
  Positions(const char* name, const pybind11::object& value);
  [[nodiscard]] std::span<const Eigen::Vector3d> view() const { return view_; }

 private:
  pybind11::object keep_;
  std::span<const Eigen::Vector3d> view_;
};

/// Three numbers. @throws InvalidArgument
Eigen::Vector3d vector3(const char* name, const pybind11::object& value);

/// [count] numbers. @throws InvalidArgument
std::vector<double> numbers1(const char* name, const pybind11::object& value, std::size_t count);

/// A pose as a 4x4 matrix. @throws InvalidArgument (shape, type), UnusableInput (last row); the field checks the rest
Eigen::Isometry3d poseOf(const char* name, const pybind11::object& value);

/// A new array of three numbers.
pybind11::array_t<double> arrayOf(const Eigen::Vector3d& v);
pybind11::array_t<float> arrayOf(const Eigen::Vector3f& v);

/// An array [n] or [n x 3] that views memory of `owner`, read-only; it keeps the owner alive.
/// @param stride  bytes from one element to the next
pybind11::array viewInto(const pybind11::object& owner, const pybind11::dtype& type, const void* first,
                         std::size_t count, std::size_t stride, int components = 1);

/// Runs a call into the library without the interpreter's lock. Other exceptions become InternalError.
template <typename Body>
auto withoutLock(const Body& body) {
  const pybind11::gil_scoped_release released;
  try {
    return body();
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;  // the module's translator knows it
  } catch (const std::exception& e) {
    throw InternalError("internal", "", e.what(), "This is a bug; please report it");
  }
}

}  // namespace accessvdb::python
