// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What points were seen from where the set of directions is larger than a mask.
#include <algorithm>
#include <array>
#include <cmath>

#include "points/bits_of_bytes.h"
#include "points/point_store.h"

namespace accessvdb::internal {

void PointStore::joinSeen(std::uint32_t id, std::span<std::uint64_t> words) const {
  for (std::size_t w = 0; w < words.size(); ++w) words[w] |= seen_[seenAt(id) + w];
}

/// As directionsTowards(), for a wide set: what a point was seen from goes into the store word by word.
bool PointStore::addWideTowards(std::uint32_t id, const Eigen::Vector3f& from_L, const Eigen::Vector3f& to_L) {
  const float dx = to_L.x() - from_L.x(), dy = to_L.y() - from_L.y(), dz = to_L.z() - from_L.z();
  const float length = std::sqrt(dx * dx + dy * dy + dz * dz);
  if (!(length > 0)) return false;
  const float ux = dx / length, uy = dy / length, uz = dz / length;
  const auto least = static_cast<float>(params_.approach.observation_cos_min);
  std::uint64_t gained = 0;
  for (std::size_t w = 0; w < static_cast<std::size_t>(words_); ++w) {
    const float* const a = axes_xyz_.data() + 3 * 64 * w;
    const std::size_t count = std::min<std::size_t>(64, num_directions_ - 64 * w);
    std::array<std::uint8_t, 64> within = {};
    for (std::size_t d = 0; d < count; ++d) {
      within[d] = ux * a[3 * d] + uy * a[3 * d + 1] + uz * a[3 * d + 2] > least ? 1 : 0;
    }
    std::uint64_t mask = 0;
    for (std::size_t d = 0; d < 64; d += 8) mask |= bitsOfBytes(within.data() + d) << d;
    std::uint64_t& word = seen_[seenAt(id) + w];
    gained |= mask & ~word;
    word |= mask;
  }
  return gained != 0;
}

}  // namespace accessvdb::internal
