// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "mirror/nanovdb_mirror.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

#include "accessvdb/error.h"
#include "mirror/host_topology.h"

namespace accessvdb::internal {
namespace {

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
using nanovdb::Coord;

// The layout that the patches stand on. Another NanoVDB that changes it must not compile.
static_assert(sizeof(UpperData) == 270400 && sizeof(LowerData) == 33856 && sizeof(LeafData) == 160);
static_assert(sizeof(UpperData::Tile) == 8 && sizeof(RootData::Tile) == 32);
static_assert(offsetof(LeafData, mValues) == offsetof(LeafData, mValueMask) + sizeof(LeafBits));
static_assert(std::is_same_v<RootData::KeyT, std::uint64_t>);

constexpr std::uint64_t kTreeOffset = sizeof(GridData);
constexpr std::uint64_t kRootOffset = kTreeOffset + sizeof(TreeData);
constexpr std::uint64_t kTilesOffset = kRootOffset + sizeof(RootData);
constexpr std::uint64_t kLeafBitsOffset = offsetof(LeafData, mValueMask);
static_assert(kTilesOffset % NANOVDB_DATA_ALIGNMENT == 0);

/// Fewer leaves than this are not worth several threads, which wait for memory together instead of one by one.
constexpr std::size_t kLeastParallel = 2048;
/// Shares of the leaves that threads take: more than there are threads costs a glance at each change.
constexpr std::uint32_t kShares = 32;
/// Leaves handed to the arena at a time.
constexpr std::size_t kStagedAtOnce = 1u << 16;

}  // namespace

class NanoVdbMirror::Impl {
 public:
  Impl(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m, std::uint32_t root_capacity);
  void applyParts(std::span<const std::span<const LeafChange>> parts);
  void clear();

  [[nodiscard]] std::uint64_t hostBytes() const noexcept;

  std::unique_ptr<kernels::MirrorArena> arena_;
  std::uint32_t root_capacity_;
  std::uint64_t top_ = 0;  ///< [B] of the arena in use
  std::uint64_t leaf_count_ = 0;
  MirrorTraffic traffic_;

  RootTable root_table_;
  std::vector<std::unique_ptr<InternalShadow<5>>> uppers_;
  std::vector<std::unique_ptr<InternalShadow<4>>> lowers_;
  std::vector<std::unique_ptr<LeafChunk>> chunks_;
  std::vector<std::uint32_t> listed_;  ///< slots of leaves that may have bits

 private:
  /// A node that was added and is not published yet.
  struct Added {
    Coord origin;
    std::uint32_t parent, entry, index;
  };
  using Lower = InternalShadow<4>;
  using Upper = InternalShadow<5>;

  [[nodiscard]] LeafShadow& leaf(std::uint32_t slot) noexcept {
    return chunks_[slot / LeafChunk::kSize]->leaves[slot % LeafChunk::kSize];
  }
  [[nodiscard]] std::uint64_t leafOffset(std::uint32_t slot) const noexcept {
    return chunks_[slot / LeafChunk::kSize]->arena_offset + slot % LeafChunk::kSize * sizeof(LeafData);
  }
  std::uint64_t allocate(std::uint64_t bytes);
  std::uint32_t addUpper(const Coord& ijk, std::uint64_t key);
  std::uint32_t addLower(const Coord& ijk);
  std::uint32_t addLeaf(const Coord& ijk, std::uint32_t lower);
  [[nodiscard]] std::uint32_t findLower(const Coord& ijk) const noexcept;
  void locateAll();
  void setBits(std::uint64_t first_added);
  std::uint8_t setBitsOf(std::size_t i, std::uint64_t first_added) noexcept;
  void publishLeaves();
  /// Writes `bytes` bytes each; `fill(n, to)` may run on any thread.
  template <class OffsetOf, class Fill>
  void writeEach(std::size_t count, std::uint64_t bytes, const OffsetOf& offset_of, const Fill& fill);
  void publish();
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes);
  template <class Data, class Shadow>
  void publishChild(Shadow& parent, std::uint32_t entry, std::uint64_t child_offset);
  template <class Data, class Shadow>
  void publishMaskWord(Shadow& parent, std::uint32_t entry);
  template <class Data>
  void publishHeader(std::uint64_t offset, const Coord& origin);

  // Of one call.
  std::vector<const LeafChange*> changes_;
  std::vector<std::uint32_t> slots_;    ///< leaf of each change
  std::vector<std::uint32_t> patched_;  ///< slots of old leaves to rewrite
  std::vector<Added> added_uppers_, added_lowers_, added_leaves_;
  bool committed_more_ = false;
  static constexpr std::uint8_t kToList = 1, kToPatch = 2;
  std::vector<std::uint8_t> news_;      ///< of each change's leaf
  std::vector<std::uint64_t> offsets_;  ///< of writeEach
  std::vector<void*> places_;
};

NanoVdbMirror::Impl::Impl(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m, std::uint32_t root_capacity)
    : arena_(std::move(arena)), root_capacity_(root_capacity), root_table_(root_capacity) {
  const std::uint64_t head_bytes = kTilesOffset + root_capacity_ * sizeof(RootData::Tile);
  arena_->commit(head_bytes);
  top_ = head_bytes;

  // NanoVDB's node data have no constructors: they are bytes that are seen as such.
  alignas(NANOVDB_DATA_ALIGNMENT) std::byte head[kTilesOffset] = {};
  auto* grid = reinterpret_cast<GridData*>(head);
  grid->mMagic = NANOVDB_MAGIC_NUMBER;
  std::memset(&grid->mChecksum, 0xFF, sizeof(grid->mChecksum));  // disabled: it would change with every patch
  grid->mVersion = nanovdb::Version();
  grid->mFlags = 0;  // not breadth first, no boxes, no extrema: nothing here is kept up to date but the bits
  grid->mGridIndex = 0;
  grid->mGridCount = 1;
  grid->mGridSize = arena_->committedBytes();
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

void NanoVdbMirror::Impl::applyParts(std::span<const std::span<const LeafChange>> parts) {
  traffic_ = {};
  const std::uint64_t first_added = leaf_count_;
  changes_.clear();
  for (const auto& part : parts) {
    for (const LeafChange& change : part) changes_.push_back(&change);
  }
  try {
    locateAll();
    news_.resize(changes_.size());
    patched_.reserve(changes_.size());
    if (listed_.capacity() < leaf_count_) listed_.reserve(std::max<std::size_t>(leaf_count_, 2 * listed_.capacity()));
  } catch (...) {
    publish();  // leaves without bits read like no leaves
    throw;
  }
  setBits(first_added);
  traffic_.leaves_patched = patched_.size();
  traffic_.leaves_added = added_leaves_.size();
  publish();
}

void NanoVdbMirror::Impl::clear() {
  traffic_ = {};
  for (const std::uint32_t slot : listed_) {
    LeafChunk& chunk = *chunks_[slot / LeafChunk::kSize];
    chunk.listed[slot % LeafChunk::kSize / 64] = 0;  // listed neighbours in this word come in this loop too
    LeafShadow& bits = leaf(slot);
    if (bits.isEmpty()) continue;
    bits = {};
    write(leafOffset(slot) + kLeafBitsOffset, &bits, sizeof(bits));
    ++traffic_.leaves_patched;
  }
  listed_.clear();
  arena_->flush();
}

// Finds or adds the leaf of every change. Everything that can fail is in here, and nothing in here changes a bit.
void NanoVdbMirror::Impl::locateAll() {
  slots_.resize(changes_.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, changes_.size(), kLeastParallel), [&](const auto& range) {
    Coord lower_origin(1);  // of no node
    std::uint32_t lower = kNoNode;
    for (std::size_t i = range.begin(); i != range.end(); ++i) {
      const auto& [x, y, z] = changes_[i]->origin_ijk;
      if (((x | y | z) & 7) != 0) {
        throw InternalError("mirror.leaf_origin", "", "A changed leaf does not begin at a multiple of 8 voxels",
                            "Please report this");
      }
      const Coord ijk(x, y, z);
      if (const Coord origin = ijk & ~std::int32_t(OccupancyLower::MASK); !(origin == lower_origin)) {
        lower_origin = origin;
        lower = findLower(ijk);
      }
      slots_[i] = lower == kNoNode ? kNoNode : lowers_[lower]->child(OccupancyLower::CoordToOffset(ijk));
    }
  });
  for (std::size_t i = 0; i < changes_.size(); ++i) {
    if (slots_[i] != kNoNode) continue;
    const auto& [x, y, z] = changes_[i]->origin_ijk;
    const Coord ijk(x, y, z);
    std::uint32_t lower = findLower(ijk);
    // An earlier change may have added the leaf; then this one counts even if it brings no bits.
    if (lower != kNoNode) slots_[i] = lowers_[lower]->child(OccupancyLower::CoordToOffset(ijk));
    if (slots_[i] != kNoNode || !bringsBits(*changes_[i])) continue;
    if (lower == kNoNode) lower = addLower(ijk);
    slots_[i] = addLeaf(ijk, lower);
  }
}

// A leaf may come more than once, so threads share the leaves among them, by chunk, and not the changes.
void NanoVdbMirror::Impl::setBits(std::uint64_t first_added) {
  const std::uint32_t shares = changes_.size() < kLeastParallel ? 1 : kShares;
  tbb::parallel_for(std::uint32_t{0}, shares, [&](std::uint32_t share) {
    for (std::size_t i = 0; i < changes_.size(); ++i) {
      if (slots_[i] != kNoNode && slots_[i] / LeafChunk::kSize % shares == share) news_[i] = setBitsOf(i, first_added);
    }
  });
  for (std::size_t i = 0; i < changes_.size(); ++i) {
    if (slots_[i] == kNoNode) continue;
    if ((news_[i] & kToList) != 0) listed_.push_back(slots_[i]);
    if ((news_[i] & kToPatch) != 0) patched_.push_back(slots_[i]);
  }
}

// @return kToList, kToPatch: lists that the leaf belongs in and does not stand in yet
std::uint8_t NanoVdbMirror::Impl::setBitsOf(std::size_t i, std::uint64_t first_added) noexcept {
  const std::uint32_t slot = slots_[i];
  LeafShadow& bits = leaf(slot);
  const bool collides_changed = switchBits(bits.collides, changes_[i]->collides_on, changes_[i]->collides_off);
  const bool arm_free_changed = switchBits(bits.arm_free, changes_[i]->arm_free_on, changes_[i]->arm_free_off);
  if (!collides_changed && !arm_free_changed) return 0;
  LeafChunk& chunk = *chunks_[slot / LeafChunk::kSize];
  const std::uint32_t word = slot % LeafChunk::kSize / 64;
  const std::uint64_t bit = std::uint64_t(1) << (slot & 63);
  std::uint8_t news = 0;
  if ((chunk.listed[word] & bit) == 0) {
    chunk.listed[word] |= bit;
    news |= kToList;
  }
  if (slot < first_added && (chunk.patched[word] & bit) == 0) {
    chunk.patched[word] |= bit;
    news |= kToPatch;
  }
  return news;
}

// Leaves that were there before: their bits; new ones: the whole leaf.
void NanoVdbMirror::Impl::publishLeaves() {
  for (const std::uint32_t slot : patched_) {
    chunks_[slot / LeafChunk::kSize]->patched[slot % LeafChunk::kSize / 64] &= ~(std::uint64_t(1) << (slot & 63));
  }
  const auto patch = [&](std::size_t n, void* to) { std::memcpy(to, &leaf(patched_[n]), sizeof(LeafShadow)); };
  writeEach(
      patched_.size(), sizeof(LeafShadow), [&](std::size_t n) { return leafOffset(patched_[n]) + kLeafBitsOffset; },
      patch);
  const auto record = [&](std::size_t n, void* to) {
    alignas(NANOVDB_DATA_ALIGNMENT) std::byte bytes[sizeof(LeafData)] = {};
    reinterpret_cast<LeafData*>(bytes)->mBBoxMin = added_leaves_[n].origin;
    std::memcpy(bytes + kLeafBitsOffset, &leaf(added_leaves_[n].index), sizeof(LeafShadow));
    std::memcpy(to, bytes, sizeof(bytes));
  };
  writeEach(
      added_leaves_.size(), sizeof(LeafData), [&](std::size_t n) { return leafOffset(added_leaves_[n].index); },
      record);
}

template <class OffsetOf, class Fill>
void NanoVdbMirror::Impl::writeEach(std::size_t count, std::uint64_t bytes, const OffsetOf& offset_of,
                                    const Fill& fill) {
  for (std::size_t begin = 0; begin < count; begin += kStagedAtOnce) {
    const std::size_t part = std::min(count - begin, kStagedAtOnce);
    offsets_.resize(part);
    places_.resize(part);
    for (std::size_t n = 0; n < part; ++n) offsets_[n] = offset_of(begin + n);
    if (part >= kLeastParallel && arena_->stage(offsets_, bytes, places_)) {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, part, 512), [&](const auto& range) {
        for (std::size_t n = range.begin(); n != range.end(); ++n) fill(begin + n, places_[n]);
      });
      traffic_.bytes_written += part * bytes;
      continue;
    }
    std::array<std::byte, sizeof(LeafData)> buffer;
    for (std::size_t n = 0; n < part; ++n) {
      fill(begin + n, buffer.data());
      write(offsets_[n], buffer.data(), bytes);
    }
  }
}

// Bottom up, so that nothing can be reached before it is complete, and no byte twice.
void NanoVdbMirror::Impl::publish() {
  if (committed_more_) {
    const std::uint64_t size = arena_->committedBytes();
    write(offsetof(GridData, mGridSize), &size, sizeof(size));
    committed_more_ = false;
  }
  publishLeaves();
  for (const Added& added : added_lowers_) publishHeader<LowerData>(lowers_[added.index]->arena_offset, added.origin);
  for (const Added& added : added_uppers_) publishHeader<UpperData>(uppers_[added.index]->arena_offset, added.origin);

  for (const Added& added : added_leaves_) {
    publishChild<LowerData>(*lowers_[added.parent], added.entry, leafOffset(added.index));
  }
  for (const Added& added : added_leaves_) publishMaskWord<LowerData>(*lowers_[added.parent], added.entry);
  for (const Added& added : added_lowers_) {
    publishChild<UpperData>(*uppers_[added.parent], added.entry, lowers_[added.index]->arena_offset);
  }
  for (const Added& added : added_lowers_) publishMaskWord<UpperData>(*uppers_[added.parent], added.entry);

  for (const Added& added : added_uppers_) {
    RootData::Tile tile = {};
    tile.key = RootData::CoordToKey(added.origin);
    tile.child = static_cast<std::int64_t>(uppers_[added.index]->arena_offset - kRootOffset);
    write(kTilesOffset + added.entry * sizeof(tile), &tile, sizeof(tile));
  }
  if (!added_leaves_.empty() || !added_lowers_.empty() || !added_uppers_.empty()) {
    const std::uint32_t counts[3] = {static_cast<std::uint32_t>(leaf_count_),
                                     static_cast<std::uint32_t>(lowers_.size()),
                                     static_cast<std::uint32_t>(uppers_.size())};
    write(kTreeOffset + offsetof(TreeData, mNodeCount), counts, sizeof(counts));
  }
  if (!added_uppers_.empty()) {
    const auto table_size = static_cast<std::uint32_t>(uppers_.size());
    write(kRootOffset + offsetof(RootData, mTableSize), &table_size, sizeof(table_size));
  }
  arena_->flush();
  patched_.clear();
  added_leaves_.clear();
  added_lowers_.clear();
  added_uppers_.clear();
}

std::uint64_t NanoVdbMirror::Impl::allocate(std::uint64_t bytes) {
  if (top_ + bytes > arena_->committedBytes()) {
    arena_->commit(top_ + bytes);
    committed_more_ = true;
  }
  const std::uint64_t offset = top_;
  top_ += bytes;
  return offset;
}

// In the three below: first what can fail, then what changes the tree.
std::uint32_t NanoVdbMirror::Impl::addUpper(const Coord& ijk, std::uint64_t key) {
  const auto index = static_cast<std::uint32_t>(uppers_.size());
  if (index >= root_capacity_) {
    throw ResourceLimit(
        "map.root_tiles", "",
        "The map spreads over more than " + std::to_string(root_capacity_) + " regions of 4096 x 4096 x 4096 voxels",
        "Remove scans that lie far from the rest, check the poses, or use larger voxels");
  }
  auto upper = std::make_unique<Upper>();
  added_uppers_.reserve(root_capacity_);
  uppers_.reserve(root_capacity_);
  upper->arena_offset = allocate(sizeof(UpperData));
  uppers_.push_back(std::move(upper));
  added_uppers_.push_back({ijk & ~std::int32_t(OccupancyUpper::MASK), kNoNode, index, index});
  root_table_.insert(key, index);
  return index;
}

std::uint32_t NanoVdbMirror::Impl::addLower(const Coord& ijk) {
  const std::uint64_t key = RootData::CoordToKey(ijk);
  std::uint32_t parent = root_table_.find(key);
  if (parent == kNoNode) parent = addUpper(ijk, key);
  const auto index = static_cast<std::uint32_t>(lowers_.size());
  const std::uint32_t entry = OccupancyUpper::CoordToOffset(ijk);
  auto lower = std::make_unique<Lower>();
  lower->arena_offset = allocate(sizeof(LowerData));
  added_lowers_.push_back({ijk & ~std::int32_t(OccupancyLower::MASK), parent, entry, index});
  try {
    lowers_.push_back(std::move(lower));
  } catch (...) {
    added_lowers_.pop_back();
    throw;
  }
  uppers_[parent]->link(entry, index);
  return index;
}

std::uint32_t NanoVdbMirror::Impl::addLeaf(const Coord& ijk, std::uint32_t lower) {
  if (leaf_count_ == chunks_.size() * LeafChunk::kSize) {
    auto chunk = std::make_unique<LeafChunk>();
    chunk->arena_offset = allocate(LeafChunk::kSize * sizeof(LeafData));
    chunks_.push_back(std::move(chunk));
  }
  const auto slot = static_cast<std::uint32_t>(leaf_count_);
  const std::uint32_t entry = OccupancyLower::CoordToOffset(ijk);
  added_leaves_.push_back({ijk, lower, entry, slot});
  lowers_[lower]->link(entry, slot);
  ++leaf_count_;
  return slot;
}

std::uint32_t NanoVdbMirror::Impl::findLower(const Coord& ijk) const noexcept {
  const std::uint32_t upper = root_table_.find(RootData::CoordToKey(ijk));
  return upper == kNoNode ? kNoNode : uppers_[upper]->child(OccupancyUpper::CoordToOffset(ijk));
}

void NanoVdbMirror::Impl::write(std::uint64_t offset, const void* source, std::uint64_t bytes) {
  arena_->write(offset, source, bytes);
  traffic_.bytes_written += bytes;
}

template <class Data, class Shadow>
void NanoVdbMirror::Impl::publishChild(Shadow& parent, std::uint32_t entry, std::uint64_t child_offset) {
  const auto link = static_cast<std::int64_t>(child_offset - parent.arena_offset);  // signed, modulo 2^64
  write(parent.arena_offset + offsetof(Data, mTable) + entry * sizeof(link), &link, sizeof(link));
}

template <class Data, class Shadow>
void NanoVdbMirror::Impl::publishMaskWord(Shadow& parent, std::uint32_t entry) {
  const std::uint32_t word = entry >> 6;
  if (!parent.takeDirty(word)) return;
  write(parent.arena_offset + offsetof(Data, mChildMask) + word * 8, &parent.child_mask[word], 8);
}

template <class Data>
void NanoVdbMirror::Impl::publishHeader(std::uint64_t offset, const Coord& origin) {
  // Only the origin: NanoVDB finds it in the lower corner of the box. The rest of fresh memory is zero already.
  const nanovdb::CoordBBox box(origin, origin);
  write(offset + offsetof(Data, mBBox), &box, sizeof(box));
}

std::uint64_t NanoVdbMirror::Impl::hostBytes() const noexcept {
  return chunks_.size() * sizeof(LeafChunk) + lowers_.size() * sizeof(Lower) + uppers_.size() * sizeof(Upper) +
         root_table_.bytes() + (listed_.capacity() + slots_.capacity() + patched_.capacity()) * sizeof(std::uint32_t) +
         changes_.capacity() * sizeof(changes_[0]) + news_.capacity() + offsets_.capacity() * sizeof(offsets_[0]) +
         places_.capacity() * sizeof(places_[0]) +
         (added_leaves_.capacity() + added_lowers_.capacity() + added_uppers_.capacity()) * sizeof(Added);
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
void NanoVdbMirror::clear() { impl_->clear(); }

const OccupancyGrid* NanoVdbMirror::grid() const noexcept {
  return static_cast<const OccupancyGrid*>(impl_->arena_->base());
}
std::uint64_t NanoVdbMirror::leafCount() const noexcept { return impl_->leaf_count_; }
std::uint32_t NanoVdbMirror::rootTileCount() const noexcept {
  return static_cast<std::uint32_t>(impl_->uppers_.size());
}
std::uint64_t NanoVdbMirror::usedBytes() const noexcept { return impl_->top_; }
std::uint64_t NanoVdbMirror::committedBytes() const noexcept { return impl_->arena_->committedBytes(); }
std::uint64_t NanoVdbMirror::hostBytes() const noexcept { return impl_->hostBytes(); }
const MirrorTraffic& NanoVdbMirror::lastTraffic() const noexcept { return impl_->traffic_; }

}  // namespace accessvdb::internal
