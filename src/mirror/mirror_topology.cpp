// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "mirror/mirror_topology.h"

#include <algorithm>
#include <atomic>
#include <string>

#include "accessvdb/error.h"
#include "mirror/distance_leaves.h"
#include "mirror/occupancy_leaves.h"

namespace accessvdb::internal {
namespace {

using nanovdb::Coord;
// The position of a voxel does not depend on the value type.
using LowerOfAny = nanovdb::NanoLower<bool>;
using UpperOfAny = nanovdb::NanoUpper<bool>;
using RootDataOfAny = nanovdb::NanoRoot<bool>::DataType;

/// Marks a change whose leaf has to be added.
constexpr std::uint32_t kMissing = kNoNode - 1;
/// No lower node.
constexpr std::uint64_t kNoPlace = ~std::uint64_t{0};
constexpr int kEntryBits = 12;
static_assert(InternalShadow<4>::kSize == 1u << kEntryBits);
constexpr std::size_t kMinBatchesPerTask = 8;
/// Nodes that a thread takes over at a time.
constexpr std::size_t kAdoptedPerBatch = 256;
/// Below this number, lower nodes are taken over by one thread.
constexpr std::size_t kLeastLowers = 256;

/// What may be wrong with nodes that a device has added, as bits.
enum Wrong : std::uint32_t { kNothing = 0, kUnaligned = 1, kOrphan = 2, kTwice = 4 };

[[noreturn]] void refuseAdopted(const char* what) {
  throw InternalError("mirror.adopted", "", what, "Please report this");
}

/// @param wrong  any of Wrong
void refuseIfWrong(std::uint32_t wrong) {
  if ((wrong & kUnaligned) != 0) refuseAdopted("A node that the device added does not begin at a multiple of its size");
  if ((wrong & kOrphan) != 0) refuseAdopted("A node that the device added lacks the node above it");
  if ((wrong & kTwice) != 0) refuseAdopted("A node that the device added is there already");
}

/// @param mask  of the node's size
bool aligned(const std::array<std::int32_t, 3>& origin_ijk, std::uint32_t mask) {
  return (static_cast<std::uint32_t>(origin_ijk[0] | origin_ijk[1] | origin_ijk[2]) & mask) == 0;
}

Coord coordOf(const std::array<std::int32_t, 3>& ijk) { return {ijk[0], ijk[1], ijk[2]}; }

template <class Change>
Coord originOf(const Change& change) {
  return coordOf(change.origin_ijk);
}

/// Lowest voxel of the node that contains a voxel.
std::array<std::int32_t, 3> originOf(const Coord& ijk, std::uint32_t mask) {
  const Coord origin = ijk & ~static_cast<std::int32_t>(mask);
  return {origin[0], origin[1], origin[2]};
}

void prefetch([[maybe_unused]] const void* address) {
#if defined(__GNUC__)
  __builtin_prefetch(address, 1);
#endif
}

/// Changes usually come in spatial order: looks up a lower node only if the last one does not contain the leaf.
template <class Find>
class LastLower {
 public:
  explicit LastLower(const Find& find) : find_(find) {}
  std::uint32_t of(const Coord& ijk) {
    if (const Coord origin = ijk & ~std::int32_t(LowerOfAny::MASK); !(origin == origin_)) {
      origin_ = origin;
      lower_ = find_(ijk);
    }
    return lower_;
  }

 private:
  const Find& find_;
  Coord origin_{1};  ///< of no node
  std::uint32_t lower_ = kNoNode;
};

}  // namespace

template <class Leaves>
MirrorTopology<Leaves>::MirrorTopology(kernels::MirrorArena& arena, std::uint32_t root_capacity,
                                       std::uint64_t used_bytes)
    : arena_(arena), root_capacity_(root_capacity), top_(used_bytes), root_table_(root_capacity) {}

template <class Leaves>
template <class Act>
void MirrorTopology<Leaves>::forEachBatch(const Act& act) {
  forEachIndex(0, batches_.size(), kMinBatchesPerTask, [&](std::size_t b) { act(batches_[b]); });
}

template <class Leaves>
void MirrorTopology<Leaves>::locate(ChangeLists lists) {
  change_count_ = divide<Leaves>(lists, batches_);
  if (locateOnce()) return;
  merged_ = mergedByLeaf<Leaves>(lists);
  const std::span<const Change> joined = merged_;
  change_count_ = divide<Leaves>({&joined, 1}, batches_);
  if (!locateOnce()) {
    throw InternalError("mirror.leaf_twice", "", "A leaf occurred twice where none can", "Please report this");
  }
}

/// @return false if a leaf occurs more than once: then nothing was added
template <class Leaves>
bool MirrorTopology<Leaves>::locateOnce() {
  ++call_;
  added_leaves_.clear();
  slots_.resize(change_count_);
  places_.resize(change_count_);
  forEachBatch([&](ChangeBatch& batch) { locateBatch(batch); });
  const auto all = [this](bool ChangeBatch::*flag) {
    return std::all_of(batches_.begin(), batches_.end(), [&](const ChangeBatch& batch) { return batch.*flag; });
  };
  if (!all(&ChangeBatch::aligned)) {
    throw InternalError("mirror.leaf_origin", "", "A changed leaf does not begin at a multiple of 8 voxels",
                        "Please report this");
  }
  if (!all(&ChangeBatch::once)) return false;
  std::uint32_t added = 0;
  for (ChangeBatch& batch : batches_) {
    batch.first_added = added;
    added += batch.added;
  }
  if (added == 0) return true;
  for (const ChangeBatch& batch : batches_) {
    if (batch.lacks_lower) addLowersOf(batch);
  }
  reserveLeaves(added);
  added_leaves_.resize(added);
  forEachBatch([&](ChangeBatch& batch) { claimLeaves(batch); });
  // A change without bits counts if another change adds the same leaf.
  if (all(&ChangeBatch::once)) forEachBatch([&](ChangeBatch& batch) { batch.once = missesNothing(batch); });
  if (!all(&ChangeBatch::once)) {
    for (const AddedNode& leaf : added_leaves_) {
      if (leaf.parent != kNoNode) lowers_[leaf.parent].unlink(leaf.entry);
    }
    added_leaves_.clear();
    return false;
  }
  const std::uint32_t chunks = kernels::newChunks(space(), added);
  addChunks(chunks, top_);
  top_ += chunks * kernels::chunkBytes(space());
  leaf_count_ += added;
  return true;
}

template <class Leaves>
void MirrorTopology<Leaves>::locateBatch(ChangeBatch& batch) noexcept {
  const auto find = [this](const Coord& ijk) { return findLower(ijk); };
  LastLower last(find);
  std::int32_t any = 0;
  std::uint32_t* const slots = slots_.data() + batch.begin;
  std::uint64_t* const places = places_.data() + batch.begin;
  const auto linkAt = [this](std::uint64_t place) -> const std::uint32_t& {
    return lowers_[static_cast<std::uint32_t>(place >> kEntryBits)].child_plus_one[place % Lower::kSize];
  };
  const auto chunkOf = [this](std::uint32_t slot) -> LeafChunk& { return chunks_[slot / LeafChunk::kSize]; };
  // Runs each step for all, so that fetches from scattered memory overlap.
  for (std::uint32_t n = 0; n < batch.count; ++n) {
    const Coord ijk = originOf(batch.changes[n]);
    any |= ijk[0] | ijk[1] | ijk[2];
    const std::uint32_t lower = last.of(ijk);
    places[n] = lower == kNoNode ? kNoPlace : std::uint64_t{lower} << kEntryBits | LowerOfAny::CoordToOffset(ijk);
    if (lower != kNoNode) prefetch(&linkAt(places[n]));
  }
  batch.aligned = (any & 7) == 0;
  batch.once = true;
  batch.added = 0;
  batch.lacks_lower = batch.skips = false;
  for (std::uint32_t n = 0; n < batch.count; ++n) {
    slots[n] = places[n] == kNoPlace ? kNoNode : linkAt(places[n]) - 1;
    if (slots[n] != kNoNode) {
      prefetch(&chunkOf(slots[n]).call[slots[n] % LeafChunk::kSize]);
    } else if (Leaves::adds(batch.changes[n])) {
      slots[n] = kMissing;
      ++batch.added;
      batch.lacks_lower = batch.lacks_lower || places[n] == kNoPlace;
    } else {
      batch.skips = true;
    }
  }
  for (std::uint32_t n = 0; n < batch.count; ++n) {
    if (slots[n] < kMissing) batch.once = chunkOf(slots[n]).comesFirst(slots[n], call_) && batch.once;
  }
}

/// Gives the batch's new leaves their slots, in the order of the changes.
template <class Leaves>
void MirrorTopology<Leaves>::claimLeaves(ChangeBatch& batch) noexcept {
  std::uint32_t added = batch.first_added;
  for (std::uint32_t n = 0; batch.added > 0 && n < batch.count; ++n) {
    std::uint32_t& slot = slots_[batch.begin + n];
    if (slot != kMissing) continue;
    const std::uint64_t place = places_[batch.begin + n];
    const auto lower = static_cast<std::uint32_t>(place >> kEntryBits);
    const auto entry = static_cast<std::uint32_t>(place % Lower::kSize);
    slot = leaf_count_ + added;
    if (lowers_[lower].link(entry, slot)) {
      added_leaves_[added] = {lower, entry};
    } else {
      batch.once = false;
    }
    ++added;
  }
}

/// Whether the changes of the batch that found no leaf still find none.
template <class Leaves>
bool MirrorTopology<Leaves>::missesNothing(const ChangeBatch& batch) const noexcept {
  for (std::uint32_t n = 0; batch.skips && n < batch.count; ++n) {
    if (slots_[batch.begin + n] != kNoNode) continue;
    const Coord ijk = originOf(batch.changes[n]);
    const std::uint32_t lower = findLower(ijk);
    if (lower != kNoNode && lowers_[lower].child(LowerOfAny::CoordToOffset(ijk)) != kNoNode) return false;
  }
  return true;
}

template <class Leaves>
void MirrorTopology<Leaves>::addLowersOf(const ChangeBatch& batch) {
  for (std::uint32_t n = 0; n < batch.count; ++n) {
    std::uint64_t& place = places_[batch.begin + n];
    if (slots_[batch.begin + n] != kMissing || place != kNoPlace) continue;
    const Coord ijk = originOf(batch.changes[n]);
    std::uint32_t lower = findLower(ijk);
    if (lower == kNoNode) lower = addLower(ijk);
    place = std::uint64_t{lower} << kEntryBits | LowerOfAny::CoordToOffset(ijk);
  }
}

/// Sees to it that the chunks for `count` more leaves can be added. They are once that is certain: so there never is
/// more room than in the last one, which a device that adds leaves relies on.
template <class Leaves>
void MirrorTopology<Leaves>::reserveLeaves(std::uint32_t count) {
  // Two slot numbers have a special meaning.
  if (count > kMissing - 1 - leaf_count_) {
    throw ResourceLimit("map.leaves", "", "The map has more leaves than the mirror can number", "Use larger voxels");
  }
  const std::uint32_t chunks = kernels::newChunks(space(), count);
  chunks_.reserve(chunks);
  if (const std::size_t wanted = chunk_offsets_.size() + chunks; wanted > chunk_offsets_.capacity()) {
    chunk_offsets_.reserve(std::max(wanted, 2 * chunk_offsets_.capacity()));
  }
  if (const std::uint64_t end = top_ + chunks * kernels::chunkBytes(space()); end > arena_.committedBytes()) {
    arena_.commit(end);
  }
}

/// @param offset  [B] of the first; the others follow
template <class Leaves>
void MirrorTopology<Leaves>::addChunks(std::uint32_t count, std::uint64_t offset) {
  chunks_.add(count);
  for (std::uint32_t n = 0; n < count; ++n) chunk_offsets_.push_back(offset + n * kernels::chunkBytes(space()));
}

template <class Leaves>
std::uint64_t MirrorTopology<Leaves>::allocate(std::uint64_t bytes) {
  if (top_ + bytes > arena_.committedBytes()) arena_.commit(top_ + bytes);
  const std::uint64_t offset = top_;
  top_ += bytes;
  return offset;
}

// The two functions below first do what can fail, then change the tree.
template <class Leaves>
std::uint32_t MirrorTopology<Leaves>::addUpper(const Coord& ijk, std::uint64_t key) {
  const std::uint32_t index = upperCount();
  if (index >= root_capacity_) {
    throw ResourceLimit(
        "map.root_tiles", "",
        "The map spreads over more than " + std::to_string(root_capacity_) + " regions of 4096 x 4096 x 4096 voxels",
        "Remove scans that are far from the rest, check the poses, or use larger voxels");
  }
  auto upper = std::make_unique<Upper>();
  added_uppers_.reserve(root_capacity_);
  uppers_.reserve(root_capacity_);
  upper->arena_offset = allocate(sizeof(typename nanovdb::NanoUpper<typename Leaves::Build>::DataType));
  upper->origin_ijk = originOf(ijk, UpperOfAny::MASK);
  uppers_.push_back(std::move(upper));
  added_uppers_.push_back({kNoNode, index});
  root_table_.insert(key, index);
  return index;
}

template <class Leaves>
std::uint32_t MirrorTopology<Leaves>::addLower(const Coord& ijk) {
  const std::uint64_t key = RootDataOfAny::CoordToKey(ijk);
  std::uint32_t parent = root_table_.find(key);
  if (parent == kNoNode) parent = addUpper(ijk, key);
  const std::uint32_t index = lowerCount(), entry = UpperOfAny::CoordToOffset(ijk);
  lowers_.reserve(1);
  const std::uint64_t offset = allocate(sizeof(typename nanovdb::NanoLower<typename Leaves::Build>::DataType));
  added_lowers_.push_back({parent, entry});
  Lower& lower = lowers_.add();
  lower.arena_offset = offset;
  lower.origin_ijk = originOf(ijk, LowerOfAny::MASK);
  (void)uppers_[parent]->link(entry, index);  // it was not linked yet
  return index;
}

template <class Leaves>
std::uint32_t MirrorTopology<Leaves>::findLower(const Coord& ijk) const noexcept {
  const std::uint32_t upper = root_table_.find(RootDataOfAny::CoordToKey(ijk));
  return upper == kNoNode ? kNoNode : uppers_[upper]->child(UpperOfAny::CoordToOffset(ijk));
}

template <class Leaves>
void MirrorTopology<Leaves>::forgetAdded() noexcept {
  added_leaves_.clear();
  added_lowers_.clear();
  added_uppers_.clear();
  published_chunks_ = chunks_.size();
}

template <class Leaves>
kernels::GridSpace MirrorTopology<Leaves>::space() const noexcept {
  kernels::GridSpace space;
  space.top_bytes = top_;
  space.last_chunk_offset = chunk_offsets_.empty() ? 0 : chunk_offsets_.back();
  space.uppers = upperCount();
  space.lowers = lowerCount();
  space.leaves = leaf_count_;
  space.root_capacity = root_capacity_;
  space.leaf_bytes = kLeafBytes;
  return space;
}

template <class Leaves>
void MirrorTopology<Leaves>::adopt(const kernels::GridGrowth& growth, std::uint64_t grid_bytes) {
  const kernels::GridSpace before = space();
  if (growth.uppers.size() > root_capacity_ - before.uppers || growth.lowers.size() > kMissing - before.lowers ||
      growth.leaves.size() > kMissing - before.leaves) {
    refuseAdopted("The device added more nodes than the mirror can number");
  }
  const kernels::GridSpace after = kernels::grown(before, growth.counts());
  if (after == before) return;
  if (!added_uppers_.empty() || !added_lowers_.empty()) {
    refuseAdopted("The device added nodes while some of the host were not published");
  }
  if (after.top_bytes > grid_bytes) refuseAdopted("The device added nodes beyond the end of the grid");
  adoptUppers(growth, before);
  adoptLowers(growth, before);
  adoptLeaves(growth, before);
  top_ = after.top_bytes;
  leaf_count_ = after.leaves;
  published_chunks_ = chunks_.size();
}

template <class Leaves>
void MirrorTopology<Leaves>::adoptUppers(const kernels::GridGrowth& growth, const kernels::GridSpace& before) {
  for (const auto& origin_ijk : growth.uppers) {
    if (!aligned(origin_ijk, UpperOfAny::MASK)) refuseIfWrong(kUnaligned);
    const std::uint64_t key = RootDataOfAny::CoordToKey(coordOf(origin_ijk));
    if (root_table_.find(key) != kNoNode) refuseIfWrong(kTwice);
    auto upper = std::make_unique<Upper>();
    upper->arena_offset = kernels::newUpperOffset(before, upperCount() - before.uppers);
    upper->origin_ijk = origin_ijk;
    root_table_.insert(key, upperCount());
    uppers_.push_back(std::move(upper));
  }
}

template <class Leaves>
void MirrorTopology<Leaves>::adoptLowers(const kernels::GridGrowth& growth, const kernels::GridSpace& before) {
  const kernels::GrowthCounts added = growth.counts();
  lowers_.add(added.lowers);
  std::atomic<std::uint32_t> wrong = kNothing;
  forEachIndex(0, added.lowers, kLeastLowers, [&](std::size_t n) {
    const Coord ijk = coordOf(growth.lowers[n]);
    if (!aligned(growth.lowers[n], LowerOfAny::MASK)) wrong |= kUnaligned;
    const std::uint32_t index = before.lowers + static_cast<std::uint32_t>(n);
    Lower& lower = lowers_[index];
    lower.arena_offset = kernels::newLowerOffset(before, added, static_cast<std::uint32_t>(n));
    lower.origin_ijk = growth.lowers[n];
    const std::uint32_t parent = root_table_.find(RootDataOfAny::CoordToKey(ijk));
    if (parent == kNoNode) {
      wrong |= kOrphan;
      return;
    }
    const std::uint32_t entry = UpperOfAny::CoordToOffset(ijk);
    if (!uppers_[parent]->link(entry, index)) wrong |= kTwice;
    uppers_[parent]->markPublished(entry);
  });
  refuseIfWrong(wrong);
}

template <class Leaves>
void MirrorTopology<Leaves>::adoptLeaves(const kernels::GridGrowth& growth, const kernels::GridSpace& before) {
  const kernels::GrowthCounts added = growth.counts();
  addChunks(kernels::newChunks(before, added.leaves), kernels::newChunkOffset(before, added, 0));
  std::atomic<std::uint32_t> wrong = kNothing;
  const auto find = [this](const Coord& ijk) { return findLower(ijk); };
  const std::size_t batches = (growth.leaves.size() + kAdoptedPerBatch - 1) / kAdoptedPerBatch;
  forEachIndex(0, batches, kMinBatchesPerTask, [&](std::size_t b) {
    const std::size_t first = b * kAdoptedPerBatch;
    const auto leaves = growth.leaves.subspan(first, std::min(kAdoptedPerBatch, growth.leaves.size() - first));
    struct Place {
      Lower* lower = nullptr;
      std::uint32_t entry = 0;
    };
    std::array<Place, kAdoptedPerBatch> places;
    LastLower last(find);
    std::uint32_t wrong_here = kNothing;
    // Each step for all, so that fetches from scattered memory overlap.
    for (std::size_t n = 0; n < leaves.size(); ++n) {
      const Coord ijk = coordOf(leaves[n]);
      if (!aligned(leaves[n], nanovdb::NanoLeaf<bool>::MASK)) wrong_here |= kUnaligned;
      const std::uint32_t lower = last.of(ijk);
      if (lower == kNoNode) {
        wrong_here |= kOrphan;
        continue;
      }
      places[n] = {&lowers_[lower], LowerOfAny::CoordToOffset(ijk)};
      prefetch(&places[n].lower->child_plus_one[places[n].entry]);
    }
    for (std::size_t n = 0; n < leaves.size(); ++n) {
      const auto [lower, entry] = places[n];
      if (lower == nullptr) continue;
      if (!lower->link(entry, before.leaves + static_cast<std::uint32_t>(first + n))) wrong_here |= kTwice;
      lower->markPublished(entry);
    }
    if (wrong_here != kNothing) wrong |= wrong_here;
  });
  refuseIfWrong(wrong);
}

template <class Leaves>
std::uint64_t MirrorTopology<Leaves>::hostBytes() const noexcept {
  return chunks_.bytes() + lowers_.bytes() + (chunk_offsets_.capacity() + places_.capacity()) * sizeof(std::uint64_t) +
         uppers_.size() * sizeof(Upper) + root_table_.bytes() + slots_.capacity() * sizeof(std::uint32_t) +
         batches_.capacity() * sizeof(ChangeBatch) + merged_.capacity() * sizeof(Change) +
         (added_leaves_.capacity() + added_lowers_.capacity() + added_uppers_.capacity()) * sizeof(AddedNode);
}

template class MirrorTopology<OccupancyLeaves>;
template class MirrorTopology<DistanceLeaves>;

}  // namespace accessvdb::internal
