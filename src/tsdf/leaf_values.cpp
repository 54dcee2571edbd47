// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/leaf_values.h"

#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <new>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kPlainBytes = PackedLeaf::SIZE * sizeof(PackedVoxel);
/// A block that is larger is not worth a second look at its leaf.
constexpr std::size_t kMostBytes = kPlainBytes - kPlainBytes / 8;
constexpr std::uint32_t kMostAdded = 15;  ///< to the base weight of 24-bit voxels

/// @return the buffer that the leaf had, or nullptr
void* exchangeBuffer(PackedLeaf& leaf, void* buffer) {
  using Buffer = PackedLeaf::Buffer;
  alignas(Buffer) std::byte room[sizeof(Buffer)];
  auto* other =
      new (room) Buffer(openvdb::PartialCreate(), PackedVoxel(0));  // not destroyed: what it gets is not its own
  PackedVoxel::giveNext(buffer);
  other->allocate();
  leaf.swap(*other);
  return other->empty() ? nullptr : other->data();
}

}  // namespace

void CompactLeaf::free(const CompactLeaf* block) noexcept { std::free(const_cast<CompactLeaf*>(block)); }

CompactLeaf CompactLeaf::headOf(const std::uint32_t* values) {
  CompactLeaf head = {};
  std::uint32_t least = kWeightMask, most = 0;
  for (std::size_t word = 0; word < 8; ++word) {
    std::uint64_t bits = 0;
    for (std::size_t n = 0; n < 64; ++n) {
      const std::uint32_t weight = weightOf(values[64 * word + n]);
      bits |= std::uint64_t{weight != 0 ? 1U : 0U} << n;
      most = std::max(most, weight);
      least = std::min(least, weight == 0 ? kWeightMask : weight);
    }
    head.observed[word] = bits;
  }
  head.countVoxels();
  head.base_weight = most == 0 ? 0 : least;
  head.voxel_bytes = most <= head.base_weight + kMostAdded ? 3 : 4;
  return head;
}

void CompactLeaf::countVoxels() {
  std::size_t count = 0;
  for (std::size_t word = 0; word < 8; ++word) {
    first[word] = static_cast<std::uint16_t>(count);
    count += static_cast<std::size_t>(std::popcount(observed[word]));
  }
}

void CompactLeaf::packVoxels(const std::uint32_t* values, std::byte* to) const {
  for (std::size_t word = 0; word < 8; ++word) {
    for (std::uint64_t bits = observed[word]; bits != 0; bits &= bits - 1) {
      std::uint32_t voxel = values[64 * word + static_cast<std::size_t>(std::countr_zero(bits))];
      if (voxel_bytes == 3) voxel = meanOf(voxel) << 4 | (weightOf(voxel) - base_weight);
      std::memcpy(to, &voxel, voxel_bytes);
      to += voxel_bytes;
    }
  }
}

void CompactLeaf::writeTo(std::uint32_t* values) const {
  std::size_t rank = 0;
  for (std::size_t word = 0; word < 8; ++word) {
    std::uint32_t* of_word = values + 64 * word;
    std::fill_n(of_word, 64, 0U);
    for (std::uint64_t bits = observed[word]; bits != 0; bits &= bits - 1)
      of_word[std::countr_zero(bits)] = voxel(rank++);
  }
}

void allocateZeroed(PackedLeaf& leaf) {
  leaf.buffer().allocate();
  if (!newPackedVoxelsAreZero()) std::memset(plainValues(leaf), 0, kPlainBytes);
}

const CompactLeaf* makeCompact(const std::uint32_t* values) {
  CompactLeaf head = CompactLeaf::headOf(values);
  const std::size_t bytes = sizeof head + head.voxelsBytes() + 1;  // voxel() reads four bytes
  if (bytes > kMostBytes) return nullptr;
  void* block = std::malloc(bytes);
  if (block == nullptr) throw std::bad_alloc();
  head.bytes = static_cast<std::uint32_t>((bytes + sizeof(void*) + 15) / 16 * 16);
  auto* made = new (block) CompactLeaf(head);
  head.packVoxels(values, reinterpret_cast<std::byte*>(made + 1));
  return made;
}

void* putCompact(PackedLeaf& leaf, const CompactLeaf* block) {
  return exchangeBuffer(leaf, const_cast<std::uint32_t*>(&block->bytes));
}

std::uint32_t makePlain(PackedLeaf& leaf) {
  PackedLeaf::Buffer values(openvdb::PartialCreate(), PackedVoxel(0));
  values.allocate();
  const CompactLeaf* block = LeafValues(leaf).compact();
  const std::uint32_t bytes = block->bytes;
  block->writeTo(&values.data()->bits);
  leaf.swap(values);
  return bytes;
}

}  // namespace accessvdb::internal
