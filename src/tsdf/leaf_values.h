// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The values of a leaf of the map, in one of two forms.
///
/// plain    all 512 voxels of 32 bits, as OpenVDB has them: 2 KB
/// compact  only the observed ones, behind a mask, of 24 bits where their weights are close enough: mostly half of that
///
/// Both say the same. Scans write plain leaves; those that none has touched for a while become compact
/// (cold_leaves.h), and plain again before anything is written to them. The tree only knows that a leaf has a buffer:
/// compact ones are told by their address.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "processor/prefetch.h"
#include "tsdf/map_tree.h"

namespace accessvdb::internal {

/// The beginning of the block of a compact leaf; `bytes` is what the leaf's buffer points to.
struct CompactLeaf {
  std::uint32_t before_bytes;  ///< so that the address of `bytes` is not that of a plain buffer
  std::uint32_t bytes;         ///< of the whole block, with malloc's word
  std::uint64_t observed[8];
  std::uint16_t first[8];     ///< of each word of `observed`: observed voxels before it
  std::uint32_t base_weight;  ///< that 24-bit voxels add theirs to
  std::uint32_t voxel_bytes;  ///< 3 or 4

  /// Of these values, but without room for voxels. @param values  [512]
  [[nodiscard]] static CompactLeaf headOf(const std::uint32_t* values);
  /// With what a head says of itself, for voxels from elsewhere.
  void countVoxels();
  [[nodiscard]] std::size_t voxelCount() const {
    return first[7] + static_cast<std::size_t>(std::popcount(observed[7]));
  }
  [[nodiscard]] std::size_t voxelsBytes() const { return voxelCount() * voxel_bytes; }
  /// Writes voxelsBytes() bytes. @param values  that the head is of
  void packVoxels(const std::uint32_t* values, std::byte* to) const;

  [[nodiscard]] const std::byte* voxels() const { return reinterpret_cast<const std::byte*>(this + 1); }
  /// @param rank  among the observed voxels
  [[nodiscard]] std::uint32_t voxel(std::size_t rank) const {
    std::uint32_t bits;  // blocks end with a byte to spare
    std::memcpy(&bits, voxels() + rank * voxel_bytes, sizeof bits);
    if (voxel_bytes == 4) return bits;
    bits &= 0xffffff;
    return packVoxel(bits >> 4, base_weight + (bits & 15));
  }
  [[nodiscard]] std::uint32_t operator[](std::size_t n) const {
    const std::uint64_t word = observed[n >> 6], bit = std::uint64_t{1} << (n & 63);
    return (word & bit) == 0 ? 0 : voxel(first[n >> 6] + static_cast<std::size_t>(std::popcount(word & (bit - 1))));
  }
  void writeTo(std::uint32_t* values) const;

  [[nodiscard]] static bool isAt(const void* buffer) { return (reinterpret_cast<std::uintptr_t>(buffer) & 15) == 4; }
  [[nodiscard]] static const CompactLeaf* at(const void* buffer) {
    return reinterpret_cast<const CompactLeaf*>(static_cast<const std::byte*>(buffer) - offsetof(CompactLeaf, bytes));
  }
  static void free(const CompactLeaf* block) noexcept;
};
static_assert(offsetof(CompactLeaf, bytes) == 4, "malloc's blocks begin at multiples of 16");

/// Of a leaf, to be read, until it changes.
class LeafValues {
 public:
  LeafValues() = default;
  explicit LeafValues(const PackedLeaf& leaf) {
    if (leaf.buffer().empty()) return;  // data() would allocate
    const PackedVoxel* buffer = leaf.buffer().data();
    if (CompactLeaf::isAt(buffer)) {
      compact_ = CompactLeaf::at(buffer);
    } else {
      plain_ = &buffer->bits;
    }
  }

  /// Whether it has any: no if it is only cleared.
  explicit operator bool() const { return plain_ != nullptr || compact_ != nullptr; }
  /// 0 if unobserved. @param n  of 512
  [[nodiscard]] std::uint32_t operator[](std::size_t n) const { return plain_ != nullptr ? plain_[n] : (*compact_)[n]; }
  void prefetch(std::size_t n) const {
    if (plain_ != nullptr) {
      prefetchRead(plain_ + n);
    } else {
      prefetchRead(compact_, sizeof(CompactLeaf));
    }
  }

  /// Of a plain leaf, a cache line of two rows that will be written to. @param pair  of 32
  void prefetchPair(int pair) const { prefetchWrite(plain_ + 16 * pair, 1); }

  using Room = std::uint32_t[PackedLeaf::SIZE];
  /// All 512; nullptr if there are none. @param room  gets those of a compact leaf
  [[nodiscard]] const std::uint32_t* all(Room& room) const {
    if (compact_ == nullptr) return plain_;
    compact_->writeTo(room);
    return room;
  }
  /// nullptr if the leaf is not so.
  [[nodiscard]] const std::uint32_t* plain() const { return plain_; }
  [[nodiscard]] const CompactLeaf* compact() const { return compact_; }

 private:
  const std::uint32_t* plain_ = nullptr;
  const CompactLeaf* compact_ = nullptr;
};

/// The values of a plain leaf, to be written; nullptr if it is only cleared.
inline std::uint32_t* plainValues(PackedLeaf& leaf) {
  return leaf.buffer().empty() ? nullptr : &leaf.buffer().data()->bits;
}

/// Gives a leaf without values a buffer of unobserved voxels. @throws std::bad_alloc
void allocateZeroed(PackedLeaf& leaf);

/// @return a compact form of the values; nullptr if it would save too little  @throws std::bad_alloc
[[nodiscard]] const CompactLeaf* makeCompact(const std::uint32_t* values);
/// Puts makeCompact() in the place of what the leaf has. @return its plain buffer, now the caller's; nullptr: none
[[nodiscard]] void* putCompact(PackedLeaf& leaf, const CompactLeaf* block);
/// Makes a compact leaf plain. @return the bytes of the block that it had  @throws std::bad_alloc
std::uint32_t makePlain(PackedLeaf& leaf);

}  // namespace accessvdb::internal
