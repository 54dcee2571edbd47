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
  // Loops that compilers turn into vector code.
  std::int32_t least = kWeightMask, most = 0;
  for (std::size_t n = 0; n < PackedLeaf::SIZE; ++n) {
    const auto weight = static_cast<std::int32_t>(weightOf(values[n]));
    const std::int32_t if_observed = weight == 0 ? static_cast<std::int32_t>(kWeightMask) : weight;
    most = most > weight ? most : weight;
    least = least < if_observed ? least : if_observed;
  }
  for (std::size_t word = 0; word < 8; ++word) {
    for (std::size_t byte = 0; byte < 8; ++byte) {
      const std::uint32_t* const eight = values + 64 * word + 8 * byte;
      std::uint32_t bits = 0;
      for (std::size_t n = 0; n < 8; ++n) bits |= (weightOf(eight[n]) != 0 ? 1U : 0U) << n;
      head.observed[word] |= std::uint64_t{bits} << 8 * byte;
    }
  }
  head.countVoxels();
  head.base_weight = most == 0 ? 0 : static_cast<std::uint32_t>(least);
  head.voxel_bytes = static_cast<std::uint32_t>(most) <= head.base_weight + kMostAdded ? 3 : 4;
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
  const std::byte* const end = to + voxelsBytes();
  const auto pack = [&](const auto& packed) {
    for (std::size_t word = 0; word < 8; ++word) {
      for (std::uint64_t bits = observed[word]; bits != 0; bits &= bits - 1) {
        const std::uint32_t voxel = packed(values[64 * word + static_cast<std::size_t>(std::countr_zero(bits))]);
        // The next one overwrites what is too much.
        std::memcpy(to, &voxel, end - to >= static_cast<std::ptrdiff_t>(sizeof voxel) ? sizeof voxel : voxel_bytes);
        to += voxel_bytes;
      }
    }
  };
  if (voxel_bytes == 3) {
    pack([base = base_weight](std::uint32_t voxel) { return meanOf(voxel) << 4 | (weightOf(voxel) - base); });
  } else {
    pack([](std::uint32_t voxel) { return voxel; });
  }
}

void CompactLeaf::writeTo(std::uint32_t* values) const {
  const auto write = [&](const auto& unpacked) {
    const std::byte* from = voxels();
    for (std::size_t word = 0; word < 8; ++word) {
      std::uint32_t* const of_word = values + 64 * word;
      std::fill_n(of_word, 64, 0U);
      for (std::uint64_t bits = observed[word]; bits != 0; bits &= bits - 1) {
        std::uint32_t voxel;  // blocks end with a byte to spare
        std::memcpy(&voxel, from, sizeof voxel);
        from += voxel_bytes;
        of_word[std::countr_zero(bits)] = unpacked(voxel);
      }
    }
  };
  if (voxel_bytes == 3) {
    write(
        [base = base_weight](std::uint32_t voxel) { return packVoxel((voxel & 0xffffff) >> 4, base + (voxel & 15)); });
  } else {
    write([](std::uint32_t voxel) { return voxel; });
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
