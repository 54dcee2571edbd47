// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "capi/params_from_c.h"

#include <algorithm>
#include <array>
#include <type_traits>

#include "accessvdb/params_rows.h"
#include "capi/boundary.h"

namespace accessvdb::capi {

namespace {

template <typename Enum>
constexpr std::int32_t kLastInC = static_cast<std::int32_t>(kEnumWords<Enum>.size()) - 1;
template <>
constexpr std::int32_t kLastInC<UpdateRegion> = ACCESSVDB_REGION_FULL_CUBE;

template <typename Params>
void takeFromC(const accessvdb_params& c, Params& params) {
  forEachRow<Params>([&]<typename Row>(const Row& row) {
    auto& value = params.*Row::member;
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (ParamStruct<Value>) {
      takeFromC(c, value);
    } else if constexpr (Row::has_C) {
      const auto& given = c.*Row::member_in_C;
      if constexpr (std::is_same_v<Value, bool>) {
        value = requireBool(row.c_name, given);
      } else if constexpr (std::is_enum_v<Value>) {
        value = static_cast<Value>(requireChoice(row.c_name, given, 0, kLastInC<Value>));
      } else if constexpr (std::is_same_v<Value, OrientationSet>) {
        if (given != nullptr) value = OrientationSet::parse(given);
      } else if constexpr (std::is_same_v<Value, std::vector<CarriedAttribute>>) {
        if (given != nullptr) value = carryOf(given);
      } else if constexpr (std::is_same_v<Value, std::array<double, 3>>) {
        value = std::to_array(given);
      } else {
        static_assert(std::is_same_v<const Value&, decltype(given)>);
        value = given;
      }
    }
  });
}

template <typename Params>
void giveToC(const Params& params, accessvdb_params& c) {
  forEachRow<Params>([&]<typename Row>(const Row&) {
    const auto& value = params.*Row::member;
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (ParamStruct<Value>) {
      giveToC(value, c);
    } else if constexpr (Row::has_C && !std::is_same_v<Value, OrientationSet> &&
                         !std::is_same_v<Value, std::vector<CarriedAttribute>>) {  // texts C would have to free
      auto& out = c.*Row::member_in_C;
      if constexpr (std::is_same_v<Value, std::array<double, 3>>) {
        std::copy(value.begin(), value.end(), out);
      } else {
        out = static_cast<std::remove_reference_t<decltype(out)>>(value);
      }
    }
  });
}

}  // namespace

BackendKind backendFromC(std::int32_t backend) {
  return static_cast<BackendKind>(requireChoice("backend", backend, 0, kLastInC<BackendKind>));
}

FieldParams paramsFromC(const accessvdb_params& c) {
  FieldParams p;
  p.backend = backendFromC(c.backend);  // of several bad values, the first that is named
  takeFromC(c, p);
  return p;
}

FieldParams paramsOrDefaults(const accessvdb_params* params) {
  if (params == nullptr) return {};
  return paramsFromC(readSized("params", params, kParamsBytes1, paramsToC({})));
}

accessvdb_params paramsToC(const FieldParams& p) {
  accessvdb_params c = {};
  giveToC(p, c);
  return c;
}

}  // namespace accessvdb::capi
