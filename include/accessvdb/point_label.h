// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Labels and reasons of a surface point: one set of names shared by host, device, files and users.
#pragma once

#include <cstdint>

namespace accessvdb {

enum class PointLabel : std::uint8_t {
  Unscored = 0,    ///< below the confidence threshold, or never scored
  Accessible = 1,  ///< at least one direction is free
  Blocked = 2      ///< no direction is free; the reason says why
};
inline constexpr int kNumPointLabels = 3;

/// Why a point is not accessible: the stage at which the direction that came closest failed.
enum class PointReason : std::uint8_t {
  None = 0,          ///< accessible
  Confidence = 1,    ///< too few observations of the surface
  Normal = 2,        ///< no direction is inside the cone around the normal, or there is no normal
  Unseen = 3,        ///< the point was never observed from a direction inside the cone
  Unknown = 4,       ///< the approach corridor runs through unobserved space
  Arm = 5,           ///< the approach corridor is obstructed
  Tool = 6,          ///< the tool would collide
  Changed = 7,       ///< what was here has gone (ChangeMode::Full) or was removed as free
  BesideSurface = 8  ///< another point, nearer to the surface, is scored in its place (ScoringParams::point_spacing_m)
};
inline constexpr int kNumPointReasons = 9;

/// Lower-case names as written to files: "unscored", "accessible", "blocked".
constexpr const char* name(PointLabel label) {
  constexpr const char* kNames[kNumPointLabels] = {"unscored", "accessible", "blocked"};
  return kNames[static_cast<int>(label)];
}

/// Lower-case names as written to files: "none", "confidence", "normal", "unseen", "unknown", "arm", "tool",
/// "changed", "beside_surface".
constexpr const char* name(PointReason reason) {
  constexpr const char* kNames[kNumPointReasons] = {"none", "confidence", "normal",  "unseen",        "unknown",
                                                    "arm",  "tool",       "changed", "beside_surface"};
  return kNames[static_cast<int>(reason)];
}

/// Score of a point of which no direction reached the tool stage.
inline constexpr std::uint16_t kNoScore = 65535;
/// Direction index of a point without a best direction.
inline constexpr std::uint16_t kNoDirection = 65535;

}  // namespace accessvdb
