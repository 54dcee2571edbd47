// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One colour per label, the same in every file and picture: green accessible, red blocked, grey not scored. And one
/// per reason, for pictures.
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

/// The palette of Okabe and Ito (2008), "Color Universal Design", which colour-blind people can tell apart; grey where
/// too little was seen, and a lighter one beside the surface.
constexpr Rgb colourOf(PointReason reason) {
  switch (reason) {
    case PointReason::None:
      return {0, 158, 115};
    case PointReason::Confidence:
      break;
    case PointReason::Normal:
      return {204, 121, 167};
    case PointReason::Unseen:
      return {86, 180, 233};
    case PointReason::Unknown:
      return {0, 114, 178};
    case PointReason::Arm:
      return {230, 159, 0};
    case PointReason::Tool:
      return {213, 94, 0};
    case PointReason::Changed:
      return {240, 228, 66};
    case PointReason::BesideSurface:
      return {205, 207, 211};
  }
  return {150, 152, 156};
}

}  // namespace accessvdb::internal
