// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Structs of settings as Python classes: each field is an attribute and a constructor keyword, type-checked when set.
/// The library checks ranges when the settings are used.
#pragma once

#include <pybind11/pybind11.h>

#include <array>
#include <concepts>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/params_rows.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tool_geometry.h"

namespace accessvdb::python {

/// The words for an enum's values, in its order; the same as in files.
template <typename Enum>
inline constexpr auto kWords = kEnumWords<Enum>;
template <>
inline constexpr std::array kWords<io::Deskew> = {"auto", "on", "off"};
template <>
inline constexpr std::array kWords<LengthUnit> = {"m", "cm", "mm", "in"};

/// Each throws InvalidArgument "python.type" or "python.value" that names the setting.
double numberFrom(const char* name, pybind11::handle value);
bool boolFrom(const char* name, pybind11::handle value);
std::int64_t wholeNumberFrom(const char* name, pybind11::handle value, std::int64_t low, std::int64_t high);
std::uint64_t largeNumberFrom(const char* name, pybind11::handle value);
std::array<double, 3> threeNumbersFrom(const char* name, pybind11::handle value);
/// From the text of a set, or from rows of three angles (degrees) or four parts of a quaternion, w first.
OrientationSet orientationsFrom(const char* name, pybind11::handle value);
/// From a sequence of names.
std::vector<CarriedAttribute> carryFrom(const char* name, pybind11::handle value);
/// @returns the index of the word
std::size_t wordFrom(const char* name, pybind11::handle value, const char* const* words, std::size_t count);

template <typename T>
T settingFrom(const char* name, pybind11::handle value) {
  if constexpr (std::same_as<T, bool>) return boolFrom(name, value);
  if constexpr (std::same_as<T, double>) return numberFrom(name, value);
  if constexpr (std::same_as<T, std::uint64_t>) return largeNumberFrom(name, value);
  if constexpr (std::same_as<T, std::array<double, 3>>) return threeNumbersFrom(name, value);
  if constexpr (std::same_as<T, OrientationSet>) return orientationsFrom(name, value);
  if constexpr (std::same_as<T, std::vector<CarriedAttribute>>) return carryFrom(name, value);
  if constexpr (std::is_enum_v<T>) return static_cast<T>(wordFrom(name, value, kWords<T>.data(), kWords<T>.size()));
  if constexpr (std::same_as<T, int> || std::same_as<T, std::uint32_t>) {
    return static_cast<T>(wholeNumberFrom(name, value, std::numeric_limits<T>::min(), std::numeric_limits<T>::max()));
  }
}

template <typename T>
pybind11::object settingToPython(const T& value) {
  if constexpr (std::is_enum_v<T>) {
    return pybind11::str(kWords<T>[static_cast<std::size_t>(value)]);
  } else if constexpr (std::same_as<T, OrientationSet>) {
    return pybind11::str(value.text());
  } else if constexpr (std::same_as<T, std::vector<CarriedAttribute>>) {
    pybind11::tuple names(value.size());
    for (std::size_t n = 0; n < value.size(); ++n) names[n] = pybind11::str(value[n].name);
    return names;
  } else if constexpr (std::same_as<T, std::array<double, 3>>) {
    return pybind11::make_tuple(value[0], value[1], value[2]);
  } else {
    return pybind11::cast(value);
  }
}

/// @throws InvalidArgument "python.setting" listing the known names
[[noreturn]] void throwNoSuchSetting(const char* class_name, const std::string& name, const std::string& known);
/// @throws InvalidArgument "python.type"
[[noreturn]] void throwNoStruct(const char* class_name, pybind11::handle value);

/// Exposes one struct of settings to Python.
template <typename Struct>
class ACCESSVDB_PRIVATE SettingsClass {
 public:
  SettingsClass(pybind11::module_& module, const char* name, const char* doc)
      : class_(module, name, doc), fields_(std::make_shared<std::vector<Field>>()), name_(name) {
    const auto fields = fields_;  // filled later
    class_.def(
        pybind11::init([fields, name](const pybind11::kwargs& settings) { return fromDict(name, *fields, settings); }));
    class_.def("__repr__", [fields, name](const pybind11::object& self) {
      std::string text = std::string("accessvdb.") + name + "(";
      for (const Field& field : *fields) {
        if (text.back() != '(') text += ", ";
        text += std::string(field.name) + "=" + pybind11::repr(field.get(self)).template cast<std::string>();
      }
      return text + ")";
    });
    class_.def("__eq__", [fields](const pybind11::object& self, const pybind11::object& other) -> pybind11::object {
      if (!pybind11::isinstance<Struct>(other)) {
        return pybind11::reinterpret_borrow<pybind11::object>(pybind11::handle(Py_NotImplemented));
      }
      for (const Field& field : *fields) {
        if (!field.get(self).equal(field.get(other))) return pybind11::bool_(false);
      }
      return pybind11::bool_(true);
    });
    class_.attr("__hash__") = pybind11::none();
  }
  /// For more than settings.
  [[nodiscard]] pybind11::class_<Struct>& pythonClass() { return class_; }

  template <typename T>
  SettingsClass& field(const char* name, T Struct::*member, const char* doc) {
    const auto set = [name, member](Struct& s, pybind11::handle value) { s.*member = settingFrom<T>(name, value); };
    const auto get = [member](const Struct& s) { return settingToPython(s.*member); };
    class_.def_property(
        name, get, [set](Struct& s, const pybind11::object& value) { set(s, value); }, doc);
    fields_->push_back({name, set, [get](pybind11::handle self) { return get(self.cast<const Struct&>()); }});
    return *this;
  }

  /// A struct inside this one: set from its class or from a dict, read as a reference into this one.
  template <typename Inner>
  SettingsClass& nested(const char* name, Inner Struct::*member, const SettingsClass<Inner>& inner, const char* doc) {
    const auto from = inner.converter();
    const auto set = [member, from](Struct& s, pybind11::handle value) { s.*member = from(value); };
    class_.def_property(
        name, [member](Struct& s) -> Inner& { return s.*member; },
        [set](Struct& s, const pybind11::object& value) { set(s, value); },
        pybind11::return_value_policy::reference_internal, doc);
    fields_->push_back({name, set, [name](pybind11::handle self) { return self.attr(name); }});
    return *this;
  }

  /// Converts from an object of the class, a dict of its fields, or None for the defaults.
  [[nodiscard]] std::function<Struct(pybind11::handle)> converter() const {
    return [fields = fields_, name = name_](pybind11::handle value) {
      if (value.is_none()) return Struct{};
      if (pybind11::isinstance<Struct>(value)) return value.cast<Struct>();
      if (!pybind11::isinstance<pybind11::dict>(value)) throwNoStruct(name, value);
      return fromDict(name, *fields, pybind11::reinterpret_borrow<pybind11::dict>(value));
    };
  }

 private:
  struct Field {
    const char* name;
    std::function<void(Struct&, pybind11::handle)> set;
    std::function<pybind11::object(pybind11::handle)> get;
  };

  static Struct fromDict(const char* class_name, const std::vector<Field>& fields, const pybind11::dict& settings) {
    Struct made;
    for (const auto& [key, value] : settings) {
      const std::string wanted = pybind11::str(key).template cast<std::string>();
      const Field* found = nullptr;
      std::string known;
      for (const Field& field : fields) {
        if (wanted == field.name) found = &field;
        known += (known.empty() ? "" : ", ") + std::string(field.name);
      }
      if (found == nullptr) throwNoSuchSetting(class_name, wanted, known);
      found->set(made, value);
    }
    return made;
  }

  pybind11::class_<Struct> class_;
  std::shared_ptr<std::vector<Field>> fields_;
  const char* name_;
};

/// The constructor argument of AccessibilityField: FieldParams, a dict of its fields, or None. Set by bindParams().
FieldParams fieldParamsFrom(pybind11::handle value);

/// The unit of that name, or nothing for None.
std::optional<LengthUnit> unitFrom(pybind11::handle value);

}  // namespace accessvdb::python
