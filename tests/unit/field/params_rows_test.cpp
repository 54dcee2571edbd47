// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Each parameter arrives wherever parameters go: for each row of params_rows.h one value is changed, and only it.
#include "accessvdb/params_rows.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

#include "accessvdb/error.h"
#include "capi/params_from_c.h"
#include "field/state/rules_version.h"
#include "field/state/state_head.h"

namespace accessvdb {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Calls visit(row, field) for each parameter, also for those of structs inside; field(all) is its value in `all`.
template <typename Params, typename Struct, typename Visit>
void forEachParamOf(const Struct& within, const Visit& visit) {
  forEachRow<Params>([&]<typename Row>(const Row& row) {
    const auto field = [&within](auto& all) -> auto& { return within(all).*Row::member; };
    FieldParams all;
    using Value = std::remove_cvref_t<decltype(field(all))>;
    if constexpr (ParamStruct<Value>) {
      forEachParamOf<Value>(field, visit);
    } else {
      SCOPED_TRACE(row.name);
      visit(row, field);
    }
  });
}
template <typename Visit>
void forEachParam(const Visit& visit) {
  forEachParamOf<FieldParams>(
      [](auto& all) -> auto& { return all; }, visit);
}

template <typename Row>
constexpr bool kIsProjective = std::is_invocable_v<decltype(Row::member), ProjectiveParams>;

/// Says where a field runs: no label depends on it, and a state may go on elsewhere.
template <typename Row>
constexpr bool kIsPlace =
    Row::template is<&FieldParams::backend> || Row::template is<&FieldParams::threads> ||
    Row::template is<&FieldParams::fuse_on_host> || Row::template is<&FieldParams::device_cache_bytes>;

/// Another value that is within the range.
template <typename Row, typename Value>
Value otherThan(const Value& value, const Row& row, const FieldParams& all) {
  if constexpr (std::is_same_v<Value, bool>) {
    return !value;
  } else if constexpr (std::is_enum_v<Value>) {
    return static_cast<Value>((static_cast<std::size_t>(value) + 1) % kEnumWords<Value>.size());
  } else if constexpr (std::is_same_v<Value, double> && Row::has_range) {
    const ParamRange range = row.rangeIn(all);
    const double more = 1.25 * value;
    if (more > value && more <= range.high) return more;
    return range.high == kInfinity ? range.low + 1 : range.low + 0.01 * (range.high - range.low);
  } else if constexpr (std::is_arithmetic_v<Value>) {
    return value + 1;
  } else if constexpr (std::is_same_v<Value, std::array<double, 3>>) {
    return {otherThan(value[0], row, all), otherThan(value[1], row, all), otherThan(value[2], row, all)};
  } else if constexpr (std::is_same_v<Value, OrientationSet>) {
    return OrientationSet::sphere(15);
  } else if constexpr (std::is_same_v<Value, std::optional<FieldWindow>>) {
    return FieldWindow{{0, 0}, {128, 128}};
  } else if constexpr (std::is_same_v<Value, std::vector<CarriedAttribute>>) {
    return {{"tree_id", Keep::Majority}, {"species", Keep::Majority}};
  } else {
    return {otherThan(*value, row, all)};
  }
}

/// With an origin, which a window needs.
FieldParams withOrigin() {
  FieldParams params;
  params.origin_W = {{0.5, -1, 2}};
  return params;
}

/// The same parameters with another value of one.
template <typename Row, typename Field>
FieldParams changed(const Row& row, const Field& field, FieldParams params) {
  if constexpr (Row::template is<&ChangeParams::free_for_s>) params.change.mode = ChangeMode::Full;
  const FieldParams resolved = params.resolved();
  field(params) = otherThan(field(resolved), row, resolved);
  return params;
}

std::map<std::string, std::string> linesOf(const FieldParams& params) {
  std::map<std::string, std::string> lines;
  std::istringstream in(params.describe());
  for (std::string line; std::getline(in, line);) lines[line.substr(0, line.find(' '))] = line;
  return lines;
}

internal::StateHead headOf(const FieldParams& params) {
  internal::StateHead head;
  head.params = params;
  head.schema = internal::stateSchemaOf(params, false);
  head.rules_version = internal::kRulesVersion;
  return head;
}

/// What is refused if one value, or one of an array, is bad.
template <typename Field>
std::string refusedWith(FieldParams params, const Field& field, double bad) {
  using Value = std::remove_cvref_t<decltype(field(params))>;
  if constexpr (std::is_same_v<Value, std::optional<std::array<double, 3>>>) {
    field(params) = {{0, bad, 0}};
  } else if constexpr (std::is_same_v<Value, std::array<double, 3>>) {
    field(params)[1] = bad;
  } else {
    field(params) = static_cast<Value>(bad);
  }
  try {
    static_cast<void>(params.resolved());
  } catch (const InvalidArgument& error) {
    return error.subject();
  }
  return "nothing";
}

/// With the count that the compiler checks, this means that each field has its own row.
TEST(ParamRows, AreInTheOrderOfTheFields) {
  FieldParams all;
  const void* before = nullptr;
  forEachParam([&](const auto&, const auto& field) {
    EXPECT_LT(before, static_cast<const void*>(&field(all)));
    before = &field(all);
  });
}

TEST(ParamRows, ValuesOutsideTheirRangesAreRefused) {
  forEachParam([&]<typename Row>(const Row& row, const auto& field) {
    if constexpr (Row::has_range) {
      FieldParams params;
      params.change.mode = ChangeMode::Full;
      if (kIsProjective<Row>) params.tsdf.region = UpdateRegion::Projective;
      const std::string name = (kIsProjective<Row> ? "projective." : "") + std::string(row.name);
      const ParamRange range = row.rangeIn(params.resolved());
      EXPECT_NE(refusedWith(params, field, range.low), name);
      EXPECT_NE(refusedWith(params, field, range.high), name);
      if constexpr (std::is_integral_v<std::remove_cvref_t<decltype(field(params))>>) {
        EXPECT_EQ(refusedWith(params, field, range.low - 1), name);
        EXPECT_EQ(refusedWith(params, field, range.high + 1), name);
      } else {
        EXPECT_EQ(refusedWith(params, field, std::nextafter(range.low, -kInfinity)), name);
        if (range.high < kInfinity) {
          EXPECT_EQ(refusedWith(params, field, std::nextafter(range.high, kInfinity)), name);
        }
        EXPECT_EQ(refusedWith(params, field, std::numeric_limits<double>::quiet_NaN()), name);
      }
    }
  });
}

TEST(ParamRows, AreDescribed) {
  FieldParams base = withOrigin();
  base.tsdf.truncation_distance_m = 0.1;  // ranges of others are in tau
  base.change.mode = ChangeMode::Full;
  base.approach.orientations = OrientationSet::sphere(20);
  base.approach.rolls = 3;
  base.tsdf.region = UpdateRegion::Projective;
  base.carry = carryOf("class");
  base.scoring.point_spacing_m = 0.03;
  base.tsdf.clear_rays_m = 3;
  base.tsdf.platform_radius_m = 0.01;
  const auto before = linesOf(base);
  forEachParam([&]<typename Row>(const Row& row, const auto& field) {
    FieldParams params = base;
    field(params) = otherThan(field(params), row, params);
    const auto after = linesOf(params);
    std::string found;
    for (const auto& [name, line] : before) {
      if (!after.contains(name) || after.at(name) != line) found += name + " ";
    }
    const bool left_out = kIsPlace<Row> || Row::template is<&FieldParams::mirror_distance> ||
                          Row::template is<&FieldParams::origin_W> || Row::template is<&FieldParams::window>;
    std::string expected = std::string(row.c_name) + " ";
    if constexpr (kIsProjective<Row>) expected = "projective_" + expected;
    if (expected.starts_with("projective_elevation")) expected = "projective_elevation_rad ";
    if (left_out) expected.clear();
    if (Row::template is<&ChangeParams::mode> || Row::template is<&TsdfParams::region>) {
      EXPECT_NE(found.find(expected), std::string::npos) << found;  // on which other lines depend
    } else {
      EXPECT_EQ(found, expected);
    }
  });
}

TEST(ParamRows, AreSaved) {
  const FieldParams base = withOrigin();
  forEachParam([&]<typename Row>(const Row& row, const auto& field) {
    const FieldParams params = changed(row, field, base).resolved();
    const auto back = internal::headFrom(internal::bytesOf(headOf(params)));
    if (Row::template is<&UpdateParams::policy>) {
      EXPECT_FALSE(back.has_value());  // there are no states of the paper's
      return;
    }
    ASSERT_TRUE(back.has_value());
    using Value = std::remove_cvref_t<decltype(field(params))>;
    if constexpr (std::is_same_v<Value, OrientationSet>) {
      EXPECT_EQ(field(back->params).text(), field(params).text());
    } else if constexpr (std::is_same_v<Value, std::optional<FieldWindow>>) {
      ASSERT_TRUE(field(back->params).has_value());
      EXPECT_EQ(field(back->params)->core_low, field(params)->core_low);
      EXPECT_EQ(field(back->params)->core_high, field(params)->core_high);
    } else {
      EXPECT_EQ(field(back->params) == field(params), !kIsPlace<Row>);
    }
  });
}

/// A row more is another layout, for which programs need another number: where this fails, raise kStateSchema.
TEST(ParamRows, MakeStatesOfThisSchema) {
  EXPECT_EQ(internal::kStateSchema, 6u);
  EXPECT_EQ(internal::bytesOf(headOf(FieldParams{}.resolved())).size(), 431u);
}

/// Numbers that files have: below 160 of versions before leaves were compact, which must still be read.
TEST(ParamRows, KeepTheLayoutsOfEarlierStates) {
  struct Layout {
    std::uint32_t schema, plain;
    bool full_change, scored, carrying;
  };
  for (const Layout& layout :
       {Layout{6, 6, false, false, false},  Layout{7, 7, false, false, false},  Layout{8, 8, false, false, false},
        Layout{16, 6, true, false, false},  Layout{18, 8, true, false, false},  Layout{26, 6, false, true, false},
        Layout{28, 8, false, true, false},  Layout{36, 6, true, true, false},   Layout{38, 8, true, true, false},
        Layout{46, 6, false, false, true},  Layout{58, 8, true, false, true},   Layout{66, 6, false, true, true},
        Layout{78, 8, true, true, true},    Layout{86, 6, false, false, false}, Layout{108, 8, false, true, false},
        Layout{127, 7, false, false, true}, Layout{146, 6, false, true, true},  Layout{166, 6, false, false, false},
        Layout{178, 8, true, false, false}, Layout{198, 8, true, true, false},  Layout{306, 6, false, true, true}}) {
    EXPECT_TRUE(internal::isStateSchema(layout.schema)) << layout.schema;
    EXPECT_EQ(internal::plainSchema(layout.schema), layout.plain) << layout.schema;
    EXPECT_EQ(internal::isFullChangeSchema(layout.schema), layout.full_change) << layout.schema;
    EXPECT_EQ(internal::isScoredSchema(layout.schema), layout.scored) << layout.schema;
    EXPECT_EQ(internal::isCarryingSchema(layout.schema), layout.carrying) << layout.schema;
  }
  for (const std::uint32_t schema :
       {0u, 5u, 9u, 15u, 19u, 25u, 29u, 39u, 45u, 79u, 85u, 89u, 119u, 159u, 160u, 165u, 169u, 319u, 326u}) {
    EXPECT_FALSE(internal::isStateSchema(schema)) << schema;
  }
  FieldParams params = FieldParams{}.resolved();
  EXPECT_EQ(internal::stateSchemaOf(params, true), 186u);
  params.carry = carryOf("tree_id");
  EXPECT_EQ(internal::stateSchemaOf(params, false), 206u);
  params.scoring.point_spacing_m = 0.02;
  EXPECT_EQ(internal::stateSchemaOf(params, true), 306u);
}

TEST(ParamRows, GoToCAndBack) {
  const FieldParams base;
  std::vector<int> covered(sizeof(accessvdb_params), 0);
  forEachParam([&]<typename Row>(const Row& row, const auto& field) {
    if constexpr (Row::has_C) {
      accessvdb_params c = {};
      const auto at = reinterpret_cast<const char*>(&(c.*Row::member_in_C)) - reinterpret_cast<const char*>(&c);
      for (std::size_t n = 0; n < sizeof(c.*Row::member_in_C); ++n) ++covered[static_cast<std::size_t>(at) + n];
      const FieldParams params = changed(row, field, base);
      c = capi::paramsToC(params);
      if constexpr (Row::template is<&ApproachParams::orientations>) {
        EXPECT_EQ(c.orientations, nullptr);
        c.orientations = "sphere:15";
        const FieldParams back = capi::paramsFromC(c);
        EXPECT_EQ(field(back).text(), "sphere:15");
      } else if constexpr (Row::template is<&FieldParams::carry>) {
        EXPECT_EQ(c.carry, nullptr);
        c.carry = " tree_id  species ";
        const FieldParams back = capi::paramsFromC(c);
        EXPECT_EQ(field(back), field(params));
      } else {
        const FieldParams back = capi::paramsFromC(c);
        EXPECT_EQ(field(back), field(params));
        EXPECT_NE(field(params), field(base));
      }
    }
  });
  // All of the struct but struct_size and reserved: no field of C lacks a row, and none has two.
  constexpr std::size_t kReserved = offsetof(accessvdb_params, reserved);
  for (std::size_t n = 0; n < covered.size(); ++n) {
    EXPECT_EQ(covered[n], n < sizeof(std::uint32_t) || n >= kReserved ? 0 : 1) << n;
  }
}

}  // namespace
}  // namespace accessvdb
