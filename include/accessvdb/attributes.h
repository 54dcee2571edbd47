// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whole numbers that the returns of scans carry, such as a class or the number of a tree, and what becomes of them at
/// the surface points: FieldParams::carry names them, integrateScan() takes them with the returns.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {

/// In place of a value where there is none: of a return without the attribute, and of a point all of whose returns are
/// without it.
inline constexpr std::int32_t kNoAttribute = std::numeric_limits<std::int32_t>::min();

/// How a point's value follows from those of its returns.
enum class Keep : std::uint8_t {
  Majority,  ///< the one that most of its returns have, of several the lowest; returns without a value do not count
  First,     ///< that of its first return, whose position is the point's
};

struct CarriedAttribute {
  std::string name = {};  ///< of the column in files, see FieldParams::carry
  Keep keep = Keep::Majority;
  friend bool operator==(const CarriedAttribute&, const CarriedAttribute&) = default;
};

/// Carried for points.las alone (survey_frame.h): no column of other files, and in no description.
[[nodiscard]] inline bool isHidden(const CarriedAttribute& attribute) { return attribute.name.starts_with('@'); }

/// Names with a blank between them, as FieldParams::describe() says them, and back; all are of Keep::Majority.
[[nodiscard]] ACCESSVDB_API std::string carryText(const std::vector<CarriedAttribute>& carry);
[[nodiscard]] ACCESSVDB_API std::vector<CarriedAttribute> carryOf(std::string_view names);

/// One attribute of the points of a snapshot.
struct AttributeColumn {
  std::string name = {};
  std::vector<std::int32_t> values = {};  ///< [points]
};

}  // namespace accessvdb
