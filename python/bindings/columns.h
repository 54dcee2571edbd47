// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Arrays of structs as columns: each field a NumPy array that views the structs, nothing copied.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <vector>

#include "accessvdb/export.h"
#include "bindings/arrays.h"

namespace accessvdb::python {

/// One field of a struct: its name, type, offset and number of elements.
struct ACCESSVDB_PRIVATE Column {
  const char* name;
  pybind11::dtype type;
  std::size_t offset_bytes;
  int components;
  const char* doc;
};

/// The type of a field's elements and their number.
template <typename Member>
struct ComponentsOf {
  using Scalar = Member;
  static constexpr int kCount = 1;
};
template <typename Member>
requires std::is_enum_v<Member>
struct ComponentsOf<Member> {
  using Scalar = std::underlying_type_t<Member>;
  static constexpr int kCount = 1;
};
template <typename Number>
struct ComponentsOf<Eigen::Matrix<Number, 3, 1>> {
  using Scalar = Number;
  static constexpr int kCount = 3;
};

template <typename Struct, typename Member>
Column column(const char* name, Member Struct::*member, const char* doc) {
  using Components = ComponentsOf<Member>;
  static_assert(sizeof(Member) == Components::kCount * sizeof(typename Components::Scalar));
  static const Struct example;
  const auto offset = reinterpret_cast<const char*>(&(example.*member)) - reinterpret_cast<const char*>(&example);
  return {name, pybind11::dtype::of<typename Components::Scalar>(), static_cast<std::size_t>(offset),
          Components::kCount, doc};
}

/// The dtype of all columns together, with their offsets in the struct.
pybind11::dtype recordType(const std::vector<Column>& columns, std::size_t struct_bytes);

/// Adds a property for every column, `records` with all of them as one structured array, and the length.
/// @param rows  the owner's structs; they must not move while the owner lives
template <typename Owner, typename Struct, typename... Options>
void addColumns(pybind11::class_<Owner, Options...>& owner, std::vector<Struct> Owner::*rows,
                const std::vector<Column>& columns) {
  for (const Column& column : columns) {
    const auto view = [rows, column](const pybind11::object& self) {
      const std::vector<Struct>& structs = self.cast<const Owner&>().*rows;
      const auto* first = reinterpret_cast<const char*>(structs.data());
      if (first != nullptr) first += column.offset_bytes;
      return viewInto(self, column.type, first, structs.size(), sizeof(Struct), column.components);
    };
    owner.def_property_readonly(column.name, view, column.doc);
  }
  owner.def_property_readonly(
      "records",
      [rows, columns](const pybind11::object& self) {
        const std::vector<Struct>& structs = self.cast<const Owner&>().*rows;
        return viewInto(self, recordType(columns, sizeof(Struct)), structs.data(), structs.size(), sizeof(Struct));
      },
      "(N,) structured array of all columns, over the same memory.");
  owner.def("__len__", [rows](const Owner& o) { return (o.*rows).size(); });
}

}  // namespace accessvdb::python
