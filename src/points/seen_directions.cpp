// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/seen_directions.h"

#include <algorithm>
#include <cmath>

#include "points/bits_of_bytes.h"
#include "processor/prefetch.h"

namespace accessvdb::internal {
namespace {

/// Viewpoints nearer than this to a stored one are not stored (docs/PAPER_MAP.md, "Surface points").
constexpr float kViewpointSpacing_m = 0.10f;

}  // namespace

std::span<std::uint64_t> StoredSeen::clearWords(std::size_t count) {
  mask = {};
  wide.clear();
  if (count <= static_cast<std::size_t>(kernels::kMaxDirectionWords)) return std::span(mask.word).first(count);
  wide.resize(count);
  return wide;
}

ViewCones::ViewCones(kernels::DirectionTable table, double cos_min)
    : table_(std::move(table)),
      words_((static_cast<std::size_t>(table_.numDirections()) + 63) / 64),
      cos_min_(static_cast<float>(cos_min)) {}

template <typename Found>
void ViewCones::forEachWord(const Eigen::Vector3f& from_L, const Eigen::Vector3f& to_L, Found&& found) const {
  const float dx = to_L.x() - from_L.x(), dy = to_L.y() - from_L.y(), dz = to_L.z() - from_L.z();
  const float length = std::sqrt(dx * dx + dy * dy + dz * dz);
  if (!(length > 0)) return;
  const float ux = dx / length, uy = dy / length, uz = dz / length;
  const float least = cos_min_;
  const bool level = table_.axes_xyz.empty();
  const auto count = static_cast<std::size_t>(table_.numDirections());
  for (std::size_t w = 0; w < words_; ++w) {
    // First one byte per direction, which vectorises; then eight bytes of 0 or 1 become eight bits at a time.
    std::array<std::uint8_t, 64> within = {};
    const std::size_t here = std::min<std::size_t>(64, count - 64 * w);
    if (level) {
      const float* const xy = table_.xy.data() + 2 * 64 * w;
      for (std::size_t d = 0; d < here; ++d) within[d] = ux * xy[2 * d] + uy * xy[2 * d + 1] > least ? 1 : 0;
    } else {
      const float* const a = table_.axes_xyz.data() + 3 * 64 * w;
      for (std::size_t d = 0; d < here; ++d) {
        within[d] = ux * a[3 * d] + uy * a[3 * d + 1] + uz * a[3 * d + 2] > least ? 1 : 0;
      }
    }
    std::uint64_t bits = 0;
    for (std::size_t d = 0; d < 64; d += 8) bits |= bitsOfBytes(within.data() + d) << d;
    found(w, bits);
  }
}

void SeenBits::clear(std::uint32_t id) {
  for (std::size_t w = 0; w < cones_.words(); ++w) seen_[at(id) + w] = 0;
}

void SeenBits::prefetch(std::uint32_t id) const { prefetchRead(&seen_[at(id)]); }

bool SeenBits::add(std::uint32_t id, const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L, std::uint32_t /*pose*/) {
  std::uint64_t gained = 0;
  cones_.forEachWord(p_L, q_L, [&](std::size_t w, std::uint64_t bits) {
    std::uint64_t& word = seen_[at(id) + w];
    gained |= bits & ~word;
    word |= bits;
  });
  return gained != 0;
}

void SeenBits::join(std::uint32_t id, const Eigen::Vector3f& /*first_L*/, std::span<std::uint64_t> words) const {
  for (std::size_t w = 0; w < words.size(); ++w) words[w] |= seen_[at(id) + w];
}

StoredSeen SeenBits::stored(std::uint32_t id) const {
  StoredSeen stored;
  join(id, {}, stored.clearWords(cones_.words()));
  return stored;
}

bool SeenBits::canBe(const StoredSeen& stored) const {
  const std::span<const std::uint64_t> words = stored.words();
  const std::size_t count = cones_.words();
  const bool is_wide = kernels::isWide(cones_.numDirections());
  if (words.size() != (is_wide ? count : std::size(stored.mask.word))) return false;
  const std::size_t unused = 64 * count - static_cast<std::size_t>(cones_.numDirections());  // of the last word
  return unused == 0 || words[count - 1] >> (64 - unused) == 0;
}

const ChunkedArray<Eigen::Vector3f>& SeenBits::poses() const {
  static const ChunkedArray<Eigen::Vector3f> kNoPoses;
  return kNoPoses;
}

void SeenBits::restore(std::uint32_t id, const StoredSeen& stored) {
  const std::span<const std::uint64_t> words = stored.words();
  for (std::size_t w = 0; w < cones_.words(); ++w) seen_[at(id) + w] = words[w];
}

bool SeenFromViewpoints::add(std::uint32_t id, const Eigen::Vector3f& /*p_L*/, const Eigen::Vector3f& q_L,
                             std::uint32_t pose) {
  Viewpoints& views = viewpoints_[id];
  if (views.count == Viewpoints::kMost) return false;
  for (std::uint32_t n = 0; n < views.count; ++n) {
    if ((poses_[views.pose[n]] - q_L).norm() < kViewpointSpacing_m) return false;
  }
  views.pose[views.count++] = pose;
  return true;
}

void SeenFromViewpoints::join(std::uint32_t id, const Eigen::Vector3f& first_L, std::span<std::uint64_t> words) const {
  const Viewpoints& views = viewpoints_[id];
  for (std::uint32_t n = 0; n < views.count; ++n) {
    cones_.forEachWord(first_L, poses_[views.pose[n]], [&](std::size_t w, std::uint64_t bits) { words[w] |= bits; });
  }
}

bool SeenFromViewpoints::canBe(const StoredSeen& stored) const {
  const Viewpoints& views = stored.views;
  if (views.count > Viewpoints::kMost) return false;
  return std::all_of(views.pose.begin(), views.pose.begin() + views.count,
                     [&](std::uint32_t pose) { return pose < poses_.size(); });
}

std::uint32_t SeenFromViewpoints::addPoses(std::span<const Eigen::Vector3f> q_L) {
  const auto first = static_cast<std::uint32_t>(poses_.size());
  for (const Eigen::Vector3f& q : q_L) poses_.push_back(q);
  return first;
}

SeenDirections::SeenDirections(const ApproachParams& resolved, kernels::DirectionTable table)
    : num_directions_(table.numDirections()), form_(formFor(resolved, std::move(table))) {}

SeenDirections::Form SeenDirections::formFor(const ApproachParams& resolved, kernels::DirectionTable table) {
  ViewCones cones(std::move(table), resolved.observation_cos_min);
  if (resolved.viewpoints) return SeenFromViewpoints(std::move(cones));
  return SeenBits(std::move(cones));
}

DirectionMask SeenDirections::mask(std::uint32_t id, const Eigen::Vector3f& first_L) const {
  DirectionMask mask = {};
  if (!isWide()) join(id, first_L, std::span(mask.word).first(static_cast<std::size_t>(directionWords())));
  return mask;
}

}  // namespace accessvdb::internal
