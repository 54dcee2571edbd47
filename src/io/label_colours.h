// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One colour per label, the same in every file and picture: green accessible, red blocked, grey not scored.
#pragma once

#include <array>
#include <cstdint>

#include "accessvdb/point_label.h"

namespace accessvdb::internal {

using Rgb = std::array<std::uint8_t, 3>;

constexpr Rgb colourOf(PointLabel label) {
  switch (label) {
    case PointLabel::Accessible:
      return {46, 160, 67};
    case PointLabel::Blocked:
      return {215, 58, 60};
    case PointLabel::Unscored:
      break;
  }
  return {150, 152, 156};
}

}  // namespace accessvdb::internal
