// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/device_points.h"

#include <algorithm>
#include <vector>

#include "accessvdb/error.h"

namespace accessvdb::internal {
namespace {
/// State arrays grow by a quarter, but at least by this many points.
constexpr std::uint32_t kLeastGrowth = 1 << 16;
}  // namespace

PointsOnDevice::PointsOnDevice(kernels::Backend& backend, int direction_words, bool rolls)
    : memory_(backend), words_(direction_words), rolls_(rolls) {}

void PointsOnDevice::shareWith(const PointsOnDevice& owner) {
  if (capacity_ > 0 || owner.words_ != words_) {
    throw InternalError("points.share", "", "A tool came to share the state of points too late", "Please report this");
  }
  owner_ = &owner;
}

void PointsOnDevice::reserve(std::uint32_t size) {
  if (size <= capacity_) return;
  const std::uint32_t wanted = size + std::max(size / 4, kLeastGrowth);
  std::uint32_t capacity = wanted;  // of the smallest array, if memory is short
  const auto grow = [&](auto& array, std::size_t each) {
    array.growWithRoom(memory_, each * size, each * wanted, each * size_);
    capacity = std::min(capacity, static_cast<std::uint32_t>(array.size() / each));
  };
  if (owner_ == nullptr) {
    grow(position_L_, 3);
    grow(normal_L_, 3);
    grow(seen_, static_cast<std::size_t>(words_));
    grow(weight_, 1);
  }
  grow(stability_, 1);
  grow(score_, 1);
  grow(direction_, 1);
  grow(label_, 1);
  grow(reason_, 1);
  if (rolls_) grow(roll_, 1);
  capacity_ = capacity;
}

void PointsOnDevice::growRaw(std::uint32_t size) {
  reserve(size);
  size_ = std::max(size_, size);
}

void PointsOnDevice::grow(std::uint32_t size) {
  if (size <= size_) return;
  const std::uint32_t before = size_, added = size - size_;
  growRaw(size);
  if (owner_ == nullptr) {
    normal_L_.upload(std::vector<float>(std::size_t{3} * added, 0.0f).data(), std::size_t{3} * added,
                     std::size_t{3} * before);
    weight_.upload(std::vector<std::uint16_t>(added, 0).data(), added, before);
  }
  stability_.upload(std::vector<float>(added, 1.0f).data(), added, before);
  score_.upload(std::vector<std::uint16_t>(added, kNoScore).data(), added, before);
  direction_.upload(std::vector<std::uint16_t>(added, kNoDirection).data(), added, before);
  label_.upload(std::vector<PointLabel>(added, PointLabel::Unscored).data(), added, before);
  reason_.upload(std::vector<PointReason>(added, PointReason::Confidence).data(), added, before);
  if (rolls_) roll_.upload(std::vector<std::uint8_t>(added, 0).data(), added, before);
}

kernels::PointStateView PointsOnDevice::view() const {
  kernels::PointStateView view;
  const PointsOnDevice& shared = owner_ != nullptr ? *owner_ : *this;
  view.position_L = shared.position_L_.data();
  view.normal_L = shared.normal_L_.data();
  view.seen = shared.seen_.data();
  view.weight = shared.weight_.data();
  view.score = score_.data();
  view.direction = direction_.data();
  view.stability = stability_.data();
  view.label = label_.data();
  view.reason = reason_.data();
  view.direction_words = words_;
  if (rolls_) view.roll = roll_.data();
  return view;
}

std::uint64_t PointsOnDevice::bytesPerPoint(int direction_words, bool rolls) {
  return 6 * sizeof(float) + static_cast<std::uint64_t>(direction_words) * sizeof(std::uint64_t) +
         3 * sizeof(std::uint16_t) + sizeof(float) + sizeof(PointLabel) + sizeof(PointReason) + (rolls ? 1 : 0);
}

}  // namespace accessvdb::internal
