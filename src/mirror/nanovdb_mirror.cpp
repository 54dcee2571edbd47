// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "mirror/nanovdb_mirror.h"

#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <type_traits>
#include <vector>

#include "accessvdb/error.h"
#include "mirror/mirror_topology.h"

namespace accessvdb::internal {
namespace {

using kernels::LeafPatch;
using kernels::OccupancyGrid;
using kernels::OccupancyLeaf;
using kernels::OccupancyLower;
using kernels::OccupancyRoot;
using kernels::OccupancyTree;
using kernels::OccupancyUpper;
using GridData = OccupancyGrid::DataType;
using TreeData = OccupancyTree::DataType;
using RootData = OccupancyRoot::DataType;
using UpperData = OccupancyUpper::DataType;
using LowerData = OccupancyLower::DataType;
using LeafData = OccupancyLeaf::DataType;

// The layout that the patches stand on. Another NanoVDB that changes it must not compile.
static_assert(sizeof(UpperData) == 270400 && sizeof(LowerData) == 33856 && sizeof(LeafData) == 160);
static_assert(sizeof(UpperData::Tile) == 8 && sizeof(RootData::Tile) == 32);
static_assert(sizeof(UpperData) % LeafPatch::kUnit == 0 && sizeof(LowerData) % LeafPatch::kUnit == 0 &&
              sizeof(LeafData) % LeafPatch::kUnit == 0 && sizeof(RootData::Tile) % LeafPatch::kUnit == 0);
static_assert(offsetof(LeafData, mBBoxMin) == 0 && kernels::kLeafBitsBytes == 16);
static_assert(std::is_same_v<RootData::KeyT, std::uint64_t>);

constexpr std::uint64_t kTreeOffset = sizeof(GridData);
constexpr std::uint64_t kRootOffset = kTreeOffset + sizeof(TreeData);
constexpr std::uint64_t kTilesOffset = kRootOffset + sizeof(RootData);
static_assert(kTilesOffset % NANOVDB_DATA_ALIGNMENT == 0);

/// Fewer small writes, or blocks of changes, are not worth several threads.
constexpr std::size_t kLeastWrites = 1024, kLeastBlocks = 8;
/// Leaves whose bits are asked for ahead, as they lie anywhere in memory.
constexpr std::uint32_t kLookAhead = 8;

}  // namespace

class NanoVdbMirror::Impl {
 public:
  Impl(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m, std::uint32_t root_capacity);
  void applyParts(ChangeParts parts);

  std::unique_ptr<kernels::MirrorArena> arena_;
  MirrorTopology topology_;
  MirrorTraffic traffic_;

 private:
  [[nodiscard]] static std::uint64_t headBytes(std::uint32_t root_capacity) {
    return kTilesOffset + root_capacity * sizeof(RootData::Tile);
  }
  void publish();
  void publishBits();
  void switchInPlace(std::byte* memory);
  void stagePatches();
  void publishLeaves();
  void publishNodes();
  /// Links and mask words of children that were added.
  template <class ParentData, class ParentOf, class OffsetOf>
  void publishChildren(const std::vector<AddedNode>& added, const ParentOf& parent_of, const OffsetOf& child_offset);
  /// `count` writes of `bytes` bytes to offset_of(n); fill(n, to) may run on any thread and fills all bytes.
  template <class OffsetOf, class Fill>
  void writeEach(std::size_t count, std::uint32_t bytes, const OffsetOf& offset_of, const Fill& fill);
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes);

  std::uint64_t published_bytes_ = 0;  ///< size of the grid as it says itself
  bool writing_ = false;               ///< also after a call that failed while it wrote
  std::vector<std::uint8_t> owns_word_;
  std::vector<std::uint32_t> owners_;  ///< of publishChildren()
};

NanoVdbMirror::Impl::Impl(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m, std::uint32_t root_capacity)
    : arena_(std::move(arena)), topology_(*arena_, root_capacity, headBytes(root_capacity)) {
  arena_->commit(headBytes(root_capacity));

  // NanoVDB's node data have no constructors: they are bytes that are seen as such.
  alignas(NANOVDB_DATA_ALIGNMENT) std::byte head[kTilesOffset] = {};
  auto* grid = reinterpret_cast<GridData*>(head);
  grid->mMagic = NANOVDB_MAGIC_NUMBER;
  std::memset(&grid->mChecksum, 0xFF, sizeof(grid->mChecksum));  // disabled: it would change with every patch
  grid->mVersion = nanovdb::Version();
  grid->mFlags = 0;  // not breadth first, no boxes, no extrema: nothing here is kept up to date but the bits
  grid->mGridIndex = 0;
  grid->mGridCount = 1;
  grid->mGridSize = published_bytes_ = arena_->committedBytes();
  std::memcpy(grid->mGridName, "occupancy", sizeof("occupancy"));
  grid->mMap.set(voxel_size_m, nanovdb::Vec3d(0.0), 1.0);
  grid->mWorldBBox = nanovdb::BBox<nanovdb::Vec3R>();
  grid->mVoxelSize = nanovdb::Vec3R(voxel_size_m);
  grid->mGridClass = nanovdb::GridClass::Unknown;
  grid->mGridType = nanovdb::GridType::Boolean;
  reinterpret_cast<TreeData*>(head + kTreeOffset)->mNodeOffset[3] = sizeof(TreeData);
  reinterpret_cast<RootData*>(head + kRootOffset)->mBBox = nanovdb::CoordBBox();
  write(0, head, sizeof(head));
  arena_->flush();
}

void NanoVdbMirror::Impl::applyParts(ChangeParts parts) {
  traffic_ = {};
  if (writing_) {
    throw InternalError("mirror.half_written", "", "An earlier call failed while it wrote to the mirror",
                        "Make a new mirror");
  }
  topology_.locate(parts);
  owns_word_.reserve(std::max(topology_.addedLeaves().size(), topology_.addedLowers().size()));
  owners_.reserve(owns_word_.capacity());
  writing_ = true;
  publish();
  writing_ = false;
}

// Bottom up, so that nothing can be reached before it is complete, and no byte twice.
void NanoVdbMirror::Impl::publish() {
  if (published_bytes_ != arena_->committedBytes()) {
    published_bytes_ = arena_->committedBytes();
    write(offsetof(GridData, mGridSize), &published_bytes_, sizeof(published_bytes_));
  }
  publishBits();
  publishLeaves();
  publishNodes();
  arena_->flush();
  topology_.forgetAdded();
}

// Fresh memory is zero, so the bits of new leaves are switched like those of others.
void NanoVdbMirror::Impl::publishBits() {
  std::byte* const memory = arena_->inPlace();
  if (memory != nullptr) {
    switchInPlace(memory);
  } else {
    stagePatches();
  }
  traffic_.leaves_added = topology_.addedLeaves().size();
  traffic_.leaves_patched -= traffic_.leaves_added;
}

void NanoVdbMirror::Impl::switchInPlace(std::byte* memory) {
  std::atomic<std::uint64_t> patched = 0, words = 0;
  const std::vector<ChangeBlock>& blocks = topology_.blocks();
  forEachIndex(0, blocks.size(), kLeastBlocks, [&](std::size_t b) {
    const ChangeBlock& block = blocks[b];
    const auto bitsOf = [&](std::uint32_t n) -> std::uint64_t* {
      const std::uint32_t slot = topology_.slot(block.begin + n);
      if (slot == kNoNode) return nullptr;
      return reinterpret_cast<std::uint64_t*>(memory + topology_.leafOffset(slot) + kernels::kLeafBitsBytes);
    };
    std::uint64_t patched_here = 0, words_here = 0;
    for (std::uint32_t n = 0; n < block.count; ++n) {
#if defined(__GNUC__)
      if (n + kLookAhead < block.count) {
        const std::uint64_t* ahead = bitsOf(n + kLookAhead);
        for (std::size_t line = 0; ahead != nullptr && line < 3; ++line) __builtin_prefetch(ahead + 8 * line, 1);
      }
#endif
      std::uint64_t* const bits = bitsOf(n);
      if (bits == nullptr) continue;
      words_here += kernels::switchBits(bits, block.changes[n]);
      ++patched_here;
    }
    patched += patched_here;
    words += words_here;
  });
  traffic_.leaves_patched = patched;
  traffic_.bytes_written += words * sizeof(std::uint64_t);
}

void NanoVdbMirror::Impl::stagePatches() {
  const std::vector<ChangeBlock>& blocks = topology_.blocks();
  for (std::size_t begin = 0; begin < blocks.size();) {
    const std::uint32_t first = blocks[begin].begin;
    const kernels::StagedPatches room = arena_->stagePatches(topology_.changeCount() - first);
    std::size_t end = begin;
    std::uint32_t count = 0;
    while (end < blocks.size() && count + blocks[end].count <= room.count) count += blocks[end++].count;
    std::atomic<std::uint32_t> words = 0;
    std::atomic<std::uint64_t> patched = 0;
    forEachIndex(begin, end, kLeastBlocks, [&](std::size_t b) {
      const ChangeBlock& block = blocks[b];
      LeafPatch* const list = room.list + (block.begin - first);
      std::uint32_t words_here = 0, patched_here = 0;
      for (std::uint32_t n = 0; n < block.count; ++n) {
        const std::uint32_t slot = topology_.slot(block.begin + n);
        LeafPatch patch;
        if (slot != kNoNode) {
          patch.leaf = static_cast<std::uint32_t>(topology_.leafOffset(slot) / LeafPatch::kUnit);
          patch.mask = kernels::maskOf(block.changes[n]);
          patch.first_word = words_here;
          words_here += static_cast<std::uint32_t>(std::popcount(patch.mask));
          ++patched_here;
        }
        list[n] = patch;
      }
      // Where the words of a block lie depends on the threads; what the leaves become does not.
      const std::uint32_t place = words.fetch_add(words_here, std::memory_order_relaxed);
      std::uint64_t* to = room.words + place;
      for (std::uint32_t n = 0; n < block.count; ++n) {
        list[n].first_word += place;
        to = kernels::copyWords(block.changes[n], list[n].mask, to);
      }
      patched.fetch_add(patched_here, std::memory_order_relaxed);
    });
    arena_->endPatches(count, words);
    traffic_.leaves_patched += patched;
    traffic_.bytes_written += count * sizeof(LeafPatch) + words * sizeof(std::uint64_t);
    begin = end;
  }
}

void NanoVdbMirror::Impl::publishLeaves() {
  const std::vector<AddedNode>& leaves = topology_.addedLeaves();
  const auto offsetOf = [&](std::size_t n) {
    return topology_.leafOffset(topology_.firstAddedLeaf() + static_cast<std::uint32_t>(n));
  };
  writeEach(leaves.size(), kernels::kLeafBitsBytes, offsetOf, [&](std::size_t n, std::byte* to) {
    const std::array<std::int32_t, 3>& lower = topology_.lower(leaves[n].parent).origin_ijk;
    const nanovdb::Coord local = OccupancyLower::OffsetToLocalCoord(leaves[n].entry);  // in leaves
    const std::int32_t head[4] = {lower[0] + 8 * local[0], lower[1] + 8 * local[1], lower[2] + 8 * local[2], 0};
    std::memcpy(to, head, sizeof(head));  // no box, no flag
  });
  publishChildren<LowerData>(
      leaves, [&](std::uint32_t n) -> auto& { return topology_.lower(n); }, offsetOf);
}

void NanoVdbMirror::Impl::publishNodes() {
  const std::vector<AddedNode>&lowers = topology_.addedLowers(), &uppers = topology_.addedUppers();
  const std::size_t first_lower = topology_.lowerCount() - lowers.size();
  const std::size_t first_upper = topology_.upperCount() - uppers.size();
  const auto lowerAt = [&](std::size_t n) -> auto& {
    return topology_.lower(static_cast<std::uint32_t>(first_lower + n));
  };
  const auto upperAt = [&](std::size_t n) -> auto& {
    return topology_.upper(static_cast<std::uint32_t>(first_upper + n));
  };
  // Only the origin: NanoVDB finds it in the lower corner of the box. The rest of fresh memory is zero already.
  const auto writeBoxes = [&](std::size_t count, std::size_t place, const auto& node_at) {
    writeEach(
        count, sizeof(nanovdb::CoordBBox), [&](std::size_t n) { return node_at(n).arena_offset + place; },
        [&](std::size_t n, std::byte* to) {
          const auto& [x, y, z] = node_at(n).origin_ijk;
          const nanovdb::Coord origin(x, y, z);
          const nanovdb::CoordBBox box(origin, origin);
          std::memcpy(to, &box, sizeof(box));
        });
  };
  writeBoxes(lowers.size(), offsetof(LowerData, mBBox), lowerAt);
  writeBoxes(uppers.size(), offsetof(UpperData, mBBox), upperAt);
  publishChildren<UpperData>(
      lowers, [&](std::uint32_t n) -> auto& { return topology_.upper(n); },
      [&](std::size_t n) { return lowerAt(n).arena_offset; });
  writeEach(
      uppers.size(), sizeof(RootData::Tile),
      [&](std::size_t n) { return kTilesOffset + uppers[n].entry * sizeof(RootData::Tile); },
      [&](std::size_t n, std::byte* to) {
        RootData::Tile tile = {};
        const auto& [x, y, z] = upperAt(n).origin_ijk;
        tile.key = RootData::CoordToKey(nanovdb::Coord(x, y, z));
        tile.child = static_cast<std::int64_t>(upperAt(n).arena_offset - kRootOffset);
        std::memcpy(to, &tile, sizeof(tile));
      });
  if (!topology_.addedLeaves().empty() || !lowers.empty() || !uppers.empty()) {
    const std::uint32_t counts[3] = {topology_.leafCount(), topology_.lowerCount(), topology_.upperCount()};
    write(kTreeOffset + offsetof(TreeData, mNodeCount), counts, sizeof(counts));
  }
  if (!uppers.empty()) {
    const std::uint32_t table_size = topology_.upperCount();
    write(kRootOffset + offsetof(RootData, mTableSize), &table_size, sizeof(table_size));
  }
}

template <class ParentData, class ParentOf, class OffsetOf>
void NanoVdbMirror::Impl::publishChildren(const std::vector<AddedNode>& added, const ParentOf& parent_of,
                                          const OffsetOf& child_offset) {
  constexpr std::uint32_t kWord = sizeof(std::uint64_t);
  owns_word_.resize(added.size());
  writeEach(
      added.size(), kWord,
      [&](std::size_t n) {
        return parent_of(added[n].parent).arena_offset + offsetof(ParentData, mTable) + added[n].entry * kWord;
      },
      [&](std::size_t n, std::byte* to) {
        auto& parent = parent_of(added[n].parent);
        const auto link = static_cast<std::int64_t>(child_offset(n) - parent.arena_offset);  // signed, modulo 2^64
        std::memcpy(to, &link, sizeof(link));
        owns_word_[n] = parent.mark(added[n].entry) ? 1 : 0;
      });
  owners_.clear();
  for (std::size_t n = 0; n < added.size(); ++n) {
    if (owns_word_[n] != 0) owners_.push_back(static_cast<std::uint32_t>(n));
  }
  writeEach(
      owners_.size(), kWord,
      [&](std::size_t n) {
        const AddedNode& child = added[owners_[n]];
        return parent_of(child.parent).arena_offset + offsetof(ParentData, mChildMask) + child.entry / 64 * kWord;
      },
      [&](std::size_t n, std::byte* to) {
        const AddedNode& child = added[owners_[n]];
        auto& parent = parent_of(child.parent);
        std::memcpy(to, &parent.child_mask[child.entry / 64], kWord);
        parent.forgetDirty(child.entry);
      });
}

template <class OffsetOf, class Fill>
void NanoVdbMirror::Impl::writeEach(std::size_t count, std::uint32_t bytes, const OffsetOf& offset_of,
                                    const Fill& fill) {
  traffic_.bytes_written += count * bytes;
  if (std::byte* const memory = arena_->inPlace(); memory != nullptr) {
    forEachIndex(0, count, kLeastWrites, [&](std::size_t n) { fill(n, memory + offset_of(n)); });
    return;
  }
  for (std::size_t begin = 0; begin < count;) {
    const kernels::StagedWrites room = arena_->stageWrites(count - begin, bytes);
    forEachIndex(0, room.count, kLeastWrites, [&](std::size_t n) {
      const std::size_t place = n * room.stride;
      room.list[n] = {offset_of(begin + n), room.source + static_cast<std::uint32_t>(place), bytes};
      fill(begin + n, room.data + place);
    });
    begin += room.count;
  }
}

void NanoVdbMirror::Impl::write(std::uint64_t offset, const void* source, std::uint64_t bytes) {
  arena_->write(offset, source, bytes);
  traffic_.bytes_written += bytes;
}

NanoVdbMirror::NanoVdbMirror(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m,
                             std::uint32_t root_capacity) {
  if (!(voxel_size_m > 0 && std::isfinite(voxel_size_m))) {
    throw InvalidArgument("mirror.voxel_size_m", "", "The voxel size must be a positive number", "Give metres");
  }
  if (!(root_capacity >= 1 && root_capacity <= kMaxRootCapacity)) {
    throw InvalidArgument("mirror.root_capacity", "", "The mirror needs room for 1 to 65536 root tiles",
                          "Leave it at its default");
  }
  impl_ = std::make_unique<Impl>(std::move(arena), voxel_size_m, root_capacity);
}

NanoVdbMirror::~NanoVdbMirror() = default;

void NanoVdbMirror::apply(std::span<const LeafChange> changes) { impl_->applyParts({&changes, 1}); }
void NanoVdbMirror::applyParts(std::span<const std::span<const LeafChange>> parts) { impl_->applyParts(parts); }

const OccupancyGrid* NanoVdbMirror::grid() const noexcept {
  return static_cast<const OccupancyGrid*>(impl_->arena_->base());
}
std::uint64_t NanoVdbMirror::leafCount() const noexcept { return impl_->topology_.leafCount(); }
std::uint32_t NanoVdbMirror::rootTileCount() const noexcept { return impl_->topology_.upperCount(); }
std::uint64_t NanoVdbMirror::usedBytes() const noexcept { return impl_->topology_.usedBytes(); }
std::uint64_t NanoVdbMirror::committedBytes() const noexcept { return impl_->arena_->committedBytes(); }
std::uint64_t NanoVdbMirror::hostBytes() const noexcept { return impl_->topology_.hostBytes(); }
const MirrorTraffic& NanoVdbMirror::lastTraffic() const noexcept { return impl_->traffic_; }

}  // namespace accessvdb::internal
