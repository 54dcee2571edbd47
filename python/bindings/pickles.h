// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Objects as bytes, for pickle and copy. A pickle is (version, SHA-256, bytes) and is read by the version that made
/// it: it takes objects to other processes, as multiprocessing and Dask do, and is no file format.
#pragma once

#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/orientations.h"

namespace accessvdb::python {

/// Writes values exactly as they are. PickleReader has the same functions, so one function names the parts of a class
/// for both.
class PickleWriter {
 public:
  template <typename Value>
  void operator()(const Value& value) {
    static_assert(std::is_arithmetic_v<Value> || std::is_enum_v<Value>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  template <typename Value, std::size_t kCount>
  void operator()(const std::array<Value, kCount>& values) {
    for (const Value& value : values) (*this)(value);
  }
  template <typename Scalar, int kRows, int kColumns>
  void operator()(const Eigen::Matrix<Scalar, kRows, kColumns>& matrix) {
    for (Eigen::Index n = 0; n < kRows * kColumns; ++n) (*this)(matrix.data()[n]);
  }
  void operator()(const std::string& text) {
    (*this)(std::uint64_t{text.size()});
    bytes_ += text;
  }
  template <typename Value>
  void operator()(const std::vector<Value>& values) {
    each(values, [this](const Value& value) { (*this)(value); });
  }
  /// Calls visit(value) for each.
  template <typename Value, typename Visit>
  void each(const std::vector<Value>& values, const Visit& visit) {
    (*this)(std::uint64_t{values.size()});
    for (const Value& value : values) visit(value);
  }
  template <typename Value, typename Visit>
  void each(const std::optional<Value>& value, const Visit& visit) {
    (*this)(value.has_value());
    if (value) visit(*value);
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// Reads them back. The bytes passed their hash, so only the ends are checked. @throws InputError "pickle.damaged"
class PickleReader {
 public:
  PickleReader(const char* class_name, std::string_view bytes) : class_name_(class_name), left_(bytes) {}

  template <typename Value>
  void operator()(Value& value) {
    static_assert(std::is_arithmetic_v<Value> || std::is_enum_v<Value>);
    const std::string_view bytes = take(sizeof value);
    std::memcpy(&value, bytes.data(), bytes.size());
  }
  template <typename Value, std::size_t kCount>
  void operator()(std::array<Value, kCount>& values) {
    for (Value& value : values) (*this)(value);
  }
  template <typename Scalar, int kRows, int kColumns>
  void operator()(Eigen::Matrix<Scalar, kRows, kColumns>& matrix) {
    for (Eigen::Index n = 0; n < kRows * kColumns; ++n) (*this)(matrix.data()[n]);
  }
  void operator()(std::string& text) { text = take(count()); }
  template <typename Value>
  void operator()(std::vector<Value>& values) {
    each(values, [this](Value& value) { (*this)(value); });
  }
  template <typename Value, typename Visit>
  void each(std::vector<Value>& values, const Visit& visit) {
    values.resize(count());
    for (Value& value : values) visit(value);
  }
  template <typename Value, typename Visit>
  void each(std::optional<Value>& value, const Visit& visit) {
    bool has_value = false;
    (*this)(has_value);
    if (has_value) visit(value.emplace());
  }
  void requireEnd() const {
    if (!left_.empty()) refuse();
  }
  [[noreturn]] void refuse() const;

 private:
  /// Of what follows: each takes a byte or more.
  std::size_t count() {
    std::uint64_t count = 0;
    (*this)(count);
    if (count > left_.size()) refuse();
    return static_cast<std::size_t>(count);
  }
  std::string_view take(std::size_t bytes) {
    if (bytes > left_.size()) refuse();
    const std::string_view taken = left_.substr(0, bytes);
    left_.remove_prefix(bytes);
    return taken;
  }

  const char* class_name_;
  std::string_view left_;
};

template <typename Pickle, typename Set>
void visitOrientations(Pickle& pickle, Set& set) {
  auto& [kind, pitch_min_deg, pitch_max_deg, step_deg, with_yaw, list] = set;
  for (auto* number : {&pitch_min_deg, &pitch_max_deg, &step_deg}) pickle(*number);
  pickle(kind);
  pickle(with_yaw);
  pickle.each(list, [&](auto& orientation) {
    auto& [R_WT, yaw_rad, pitch_rad, roll_rad] = orientation;
    pickle(R_WT);
    for (auto* angle_rad : {&yaw_rad, &pitch_rad, &roll_rad}) pickle(*angle_rad);
  });
}

/// (version, SHA-256, bytes); the hash is of the class's name and the bytes.
pybind11::tuple pickleState(const char* class_name, const PickleWriter& written);
/// The bytes of such a state. @throws InputError "pickle.version", "pickle.damaged"
std::string bytesOfState(const char* class_name, const pybind11::tuple& state);

/// Lets objects of a class be copied and pickled.
/// @param write  (PickleWriter&, const Class&)  @param read  (PickleReader&) -> Class
template <typename Class, typename... Options, typename Write, typename Read>
void addPickles(pybind11::class_<Class, Options...>& to, const char* name, const Write& write, const Read& read) {
  to.def(pybind11::pickle(
      [name, write](const Class& self) {
        PickleWriter pickle;
        write(pickle, self);
        return pickleState(name, pickle);
      },
      [name, read](const pybind11::tuple& state) {
        const std::string bytes = bytesOfState(name, state);
        PickleReader pickle(name, bytes);
        Class made = read(pickle);
        pickle.requireEnd();
        return made;
      }));
  to.def("__copy__", [](const Class& self) { return Class(self); });
  to.def(
      "__deepcopy__", [](const Class& self, const pybind11::dict& /*memo*/) { return Class(self); },
      pybind11::arg("memo"));
}

}  // namespace accessvdb::python
