// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The model behind accessProbability(): the odds of a point as a sum of a few terms, by what stopped the tool there.
/// Floats throughout, without functions of the C library, so that a probability has the same bits everywhere.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "accessvdb/params.h"
#include "accessvdb/types.h"

namespace accessvdb::internal {

/// Points that share constants.
enum class ProbabilityGroup { Accessible, AccessibleWithRoom, Tool, Arm, Unknown };
inline constexpr std::size_t kProbabilityGroups = 5;
/// "accessible", "accessible_with_room", "tool", "arm", "unknown".
[[nodiscard]] const char* name(ProbabilityGroup group);

/// What the odds are made of. More collisions and less room never make a point likelier. Worse evidence, that is fewer
/// observations and more noise, never brings it nearer to what its label says: an accessible point becomes less likely,
/// a blocked one no less.
struct ProbabilityTerms {
  ProbabilityGroup group = ProbabilityGroup::Accessible;
  float collisions = 0;    ///< accessible: the share of the limit; tool: the doublings of the limit, 0 to 6
  float slant = 0;         ///< 1 - cosine between direction and normal; of those that have a direction
  float noise = 0;         ///< sigma of the ranges in voxels, up to 4
  float observations = 0;  ///< doublings of one observation, up to 12
  float limit = 0;         ///< doublings of a limit of 1, up to 10: how finely the tool is counted
  float room = 0;          ///< of a field with margins, in voxels, up to 4

  [[nodiscard]] std::array<float, 7> values() const { return {1, collisions, slant, noise, observations, limit, room}; }
};

/// The terms of the points of one tool.
class ProbabilityModel {
 public:
  ProbabilityModel() = default;  ///< says nothing
  ProbabilityModel(const FieldParams& resolved, int collision_limit);

  /// None: nothing is said of the point.
  [[nodiscard]] std::optional<ProbabilityTerms> terms(const SurfacePoint& point) const;
  /// As accessProbability(); -1 for the paper's policy.
  [[nodiscard]] float of(const SurfacePoint& point) const;

 private:
  float collision_limit_ = 0, noise_voxels_ = 0, voxel_size_m_ = 0;  ///< a limit of 0: nothing is said
};

/// Doublings of 1, straight between powers of two; x from 1 to 2^24, others count as the nearest of them.
[[nodiscard]] float doublings(float x);
/// 1 / (1 + exp(-odds)), straight between quarters, and constant beyond 8.
[[nodiscard]] float shareOfOdds(float odds);

}  // namespace accessvdb::internal
