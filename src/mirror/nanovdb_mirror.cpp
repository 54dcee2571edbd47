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
#include "mirror/grid_layout.h"
#include "mirror/mirror_topology.h"

namespace accessvdb::internal {
namespace {

using kernels::ArenaFill;
using kernels::LeafPatch;

/// Below these numbers of small writes or batches of changes, several threads do not pay off.
constexpr std::size_t kLeastWrites = 1024, kLeastBatches = 8;
/// Number of leaves whose voxels are prefetched, because they are scattered in memory.
constexpr std::uint32_t kLookAhead = 8;

std::uint32_t countOf(const std::vector<AddedNode>& nodes) { return static_cast<std::uint32_t>(nodes.size()); }

}  // namespace

template <class Leaves>
class NanoMirror<Leaves>::Impl {
 public:
  using Bytes = GridLayout<typename Leaves::Build>;
  using ChangeBatch = internal::ChangeBatch<Leaves>;

  Impl(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m, std::uint32_t root_capacity, Leaves leaves);
  void applyLists(ChangeLists<Leaves> lists);
  void reserve(std::uint64_t more_bytes);
  void adopt(const kernels::GridGrowth& growth);
  /// @throw InternalError  an earlier call failed while writing
  void requireWhole() const;

  std::unique_ptr<kernels::MirrorArena> arena_;
  MirrorTopology<Leaves> topology_;
  MirrorTraffic traffic_;

 private:
  [[nodiscard]] static std::uint64_t headBytes(std::uint32_t root_capacity) {
    return Bytes::kTiles + root_capacity * sizeof(typename Bytes::RootData::Tile);
  }
  void publish();
  void publishBackground();
  void publishChanges();
  void changeInPlace(std::byte* memory);
  void stagePatches();
  void publishLeaves();
  void publishNodes();
  /// Publishes links and mask words of added children.
  template <class ParentData, class ParentOf, class OffsetOf>
  void publishChildren(const std::vector<AddedNode>& added, const ParentOf& parent_of, const OffsetOf& child_offset);
  /// `count` writes of `bytes` bytes to offset_of(n); fill(n, to) may run on any thread and must fill all bytes.
  template <class OffsetOf, class Fill>
  void writeEach(std::size_t count, std::uint32_t bytes, const OffsetOf& offset_of, const Fill& fill);
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes);

  Leaves leaves_;
  std::uint64_t published_bytes_ = 0;  ///< grid size as stored in the grid
  bool writing_ = false;               ///< stays true after a call that failed while writing or adopting
  std::vector<std::uint8_t> owns_word_;
  std::vector<std::uint32_t> owners_;  ///< used by publishChildren()
  std::vector<ArenaFill> fills_;       ///< used by publishBackground()
};

template <class Leaves>
NanoMirror<Leaves>::Impl::Impl(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m,
                               std::uint32_t root_capacity, Leaves leaves)
    : arena_(std::move(arena)), topology_(*arena_, root_capacity, headBytes(root_capacity)), leaves_(leaves) {
  arena_->commit(headBytes(root_capacity));

  published_bytes_ = arena_->committedBytes();
  const auto head =
      Bytes::head(Leaves::kGridName, Leaves::kGridType, voxel_size_m, leaves_.background(), published_bytes_);
  write(0, head.bytes, sizeof(head.bytes));
  arena_->flush();
}

template <class Leaves>
void NanoMirror<Leaves>::Impl::applyLists(ChangeLists<Leaves> lists) {
  traffic_ = {};
  requireWhole();
  topology_.locate(lists);
  owns_word_.reserve(std::max(topology_.addedLeaves().size(), topology_.addedLowers().size()));
  owners_.reserve(owns_word_.capacity());
  writing_ = true;
  publish();
  writing_ = false;
}

template <class Leaves>
void NanoMirror<Leaves>::Impl::requireWhole() const {
  if (writing_) {
    throw InternalError("mirror.half_written", "", "An earlier call failed while writing to the mirror",
                        "Make a new mirror");
  }
}

template <class Leaves>
void NanoMirror<Leaves>::Impl::reserve(std::uint64_t more_bytes) {
  requireWhole();
  if (const std::uint64_t end = topology_.usedBytes() + more_bytes; end > arena_->committedBytes()) arena_->commit(end);
  // Also publishes nodes of a call that failed for lack of space: another writer would not find them.
  applyLists({});
}

template <class Leaves>
void NanoMirror<Leaves>::Impl::adopt(const kernels::GridGrowth& growth) {
  traffic_ = {};
  requireWhole();
  writing_ = true;
  topology_.adopt(growth, published_bytes_);
  writing_ = false;
  traffic_.leaves_added = growth.leaves.size();
}

// Publishes bottom up, so that nothing is reachable before it is complete, and no byte is written twice.
template <class Leaves>
void NanoMirror<Leaves>::Impl::publish() {
  if (published_bytes_ != arena_->committedBytes()) {
    published_bytes_ = arena_->committedBytes();
    write(offsetof(typename Bytes::GridData, mGridSize), &published_bytes_, sizeof(published_bytes_));
  }
  if (leaves_.background() != typename Leaves::Build{}) publishBackground();
  publishChanges();
  publishLeaves();
  publishNodes();
  arena_->flush();
  topology_.forgetAdded();
}

// Fresh memory is zero. If the background is not, it is written to all entries of new nodes and all voxels of new
// leaves, before anything else is.
template <class Leaves>
void NanoMirror<Leaves>::Impl::publishBackground() {
  using Build = typename Leaves::Build;
  if constexpr (sizeof(Build) == sizeof(std::uint32_t)) {
    const auto word = std::bit_cast<std::uint32_t>(leaves_.background());
    std::vector<ArenaFill>& fills = fills_;
    fills.clear();
    for (const std::uint64_t chunk : topology_.addedChunks()) {
      fills.push_back({chunk + offsetof(typename Bytes::LeafData, mValues), sizeof(Bytes::LeafData::mValues),
                       sizeof(typename Bytes::LeafData), LeafChunk::kSize, word});
    }
    for (std::uint32_t n = topology_.lowerCount() - countOf(topology_.addedLowers()); n < topology_.lowerCount(); ++n) {
      const std::uint64_t table = topology_.lower(n).arena_offset + offsetof(typename Bytes::LowerData, mTable);
      fills.push_back({table, sizeof(Bytes::LowerData::mTable), 0, 1, word});
    }
    for (std::uint32_t n = topology_.upperCount() - countOf(topology_.addedUppers()); n < topology_.upperCount(); ++n) {
      const std::uint64_t table = topology_.upper(n).arena_offset + offsetof(typename Bytes::UpperData, mTable);
      fills.push_back({table, sizeof(Bytes::UpperData::mTable), 0, 1, word});
    }
    if (std::byte* const memory = arena_->inPlace(); memory != nullptr) {
      forEachIndex(0, fills.size(), 2, [&](std::size_t n) {
        const ArenaFill& fill = fills[n];
        for (std::uint32_t piece = 0; piece < fill.count; ++piece) {
          auto* to = reinterpret_cast<std::uint32_t*>(memory + fill.offset + std::uint64_t{piece} * fill.stride);
          std::fill_n(to, fill.bytes / sizeof(word), word);
        }
      });
      for (const ArenaFill& fill : fills) traffic_.bytes_written += std::uint64_t{fill.bytes} * fill.count;
    } else {
      arena_->stageFills(fills);
      traffic_.bytes_written += fills.size() * sizeof(ArenaFill);
    }
  }
}

// Fresh memory is zero or background, so new leaves are patched like others.
template <class Leaves>
void NanoMirror<Leaves>::Impl::publishChanges() {
  std::byte* const memory = arena_->inPlace();
  if (memory != nullptr) {
    changeInPlace(memory);
  } else {
    stagePatches();
  }
  traffic_.leaves_added = topology_.addedLeaves().size();
  traffic_.leaves_patched -= traffic_.leaves_added;
}

template <class Leaves>
void NanoMirror<Leaves>::Impl::changeInPlace(std::byte* memory) {
  std::atomic<std::uint64_t> patched = 0, bytes = 0;
  const std::vector<ChangeBatch>& batches = topology_.batches();
  forEachIndex(0, batches.size(), kLeastBatches, [&](std::size_t b) {
    const ChangeBatch& batch = batches[b];
    const auto leafOf = [&](std::uint32_t n) -> std::byte* {
      const std::uint32_t slot = topology_.slot(batch.begin + n);
      return slot == kNoNode ? nullptr : memory + topology_.leafOffset(slot);
    };
    std::uint64_t patched_here = 0, bytes_here = 0;
    for (std::uint32_t n = 0; n < batch.count; ++n) {
      if (n + kLookAhead < batch.count) {
        const std::byte* ahead = leafOf(n + kLookAhead);
        if (ahead != nullptr) leaves_.prefetch(ahead, batch.changes[n + kLookAhead]);
      }
      std::byte* const leaf = leafOf(n);
      if (leaf == nullptr) continue;
      bytes_here += leaves_.changeInPlace(leaf, batch.changes[n]);
      ++patched_here;
    }
    patched += patched_here;
    bytes += bytes_here;
  });
  traffic_.leaves_patched = patched;
  traffic_.bytes_written += bytes;
}

template <class Leaves>
void NanoMirror<Leaves>::Impl::stagePatches() {
  const std::vector<ChangeBatch>& batches = topology_.batches();
  for (std::size_t begin = 0; begin < batches.size();) {
    const std::uint32_t first = batches[begin].begin;
    const kernels::StagedPatches room = arena_->stagePatches(topology_.changeCount() - first, Leaves::kPatch);
    std::size_t end = begin;
    std::uint32_t count = 0;
    while (end < batches.size() && count + batches[end].count <= room.count) count += batches[end++].count;
    std::atomic<std::uint32_t> words = 0;
    std::atomic<std::uint64_t> patched = 0;
    forEachIndex(begin, end, kLeastBatches, [&](std::size_t b) {
      const ChangeBatch& batch = batches[b];
      LeafPatch* const list = room.list + (batch.begin - first);
      std::uint32_t words_here = 0, patched_here = 0;
      for (std::uint32_t n = 0; n < batch.count; ++n) {
        const std::uint32_t slot = topology_.slot(batch.begin + n);
        LeafPatch patch;
        if (slot != kNoNode) {
          patch.leaf = static_cast<std::uint32_t>(topology_.leafOffset(slot) / LeafPatch::kUnit);
          patch.mask = leaves_.maskOf(batch.changes[n]);
          patch.first_word = words_here;
          words_here += static_cast<std::uint32_t>(std::popcount(patch.mask));
          ++patched_here;
        }
        list[n] = patch;
      }
      // The place of a batch's words depends on the threads; the resulting leaves do not.
      const std::uint32_t place = words.fetch_add(words_here, std::memory_order_relaxed);
      std::byte* to = room.words + std::size_t{place} * kernels::wordBytes(Leaves::kPatch);
      for (std::uint32_t n = 0; n < batch.count; ++n) {
        if (n + kLookAhead < batch.count) leaves_.prefetchWords(batch.changes[n + kLookAhead]);
        list[n].first_word += place;
        to = leaves_.copyWords(batch.changes[n], list[n].mask, to);
      }
      patched.fetch_add(patched_here, std::memory_order_relaxed);
    });
    arena_->endPatches(count, words);
    traffic_.leaves_patched += patched;
    traffic_.bytes_written += count * sizeof(LeafPatch) + std::uint64_t{words} * kernels::wordBytes(Leaves::kPatch);
    begin = end;
  }
}

template <class Leaves>
void NanoMirror<Leaves>::Impl::publishLeaves() {
  const std::vector<AddedNode>& leaves = topology_.addedLeaves();
  const auto offsetOf = [&](std::size_t n) {
    return topology_.leafOffset(topology_.firstAddedLeaf() + static_cast<std::uint32_t>(n));
  };
  writeEach(leaves.size(), kHeadBytes, offsetOf, [&](std::size_t n, std::byte* to) {
    const std::array<std::int32_t, 3>& lower = topology_.lower(leaves[n].parent).origin_ijk;
    const nanovdb::Coord local = nanovdb::NanoLower<bool>::OffsetToLocalCoord(leaves[n].entry);  // units: leaves
    const std::int32_t head[4] = {lower[0] + 8 * local[0], lower[1] + 8 * local[1], lower[2] + 8 * local[2], 0};
    std::memcpy(to, head, sizeof(head));  // without box and flags
  });
  publishChildren<typename Bytes::LowerData>(
      leaves, [&](std::uint32_t n) -> auto& { return topology_.lower(n); }, offsetOf);
}

template <class Leaves>
void NanoMirror<Leaves>::Impl::publishNodes() {
  using Tile = typename Bytes::RootData::Tile;
  const std::vector<AddedNode>&lowers = topology_.addedLowers(), &uppers = topology_.addedUppers();
  const std::size_t first_lower = topology_.lowerCount() - lowers.size();
  const std::size_t first_upper = topology_.upperCount() - uppers.size();
  const auto lowerAt = [&](std::size_t n) -> auto& {
    return topology_.lower(static_cast<std::uint32_t>(first_lower + n));
  };
  const auto upperAt = [&](std::size_t n) -> auto& {
    return topology_.upper(static_cast<std::uint32_t>(first_upper + n));
  };
  // Writes only the origin: NanoVDB reads it from the lower corner of the box. The rest of fresh memory is zero.
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
  writeBoxes(lowers.size(), offsetof(typename Bytes::LowerData, mBBox), lowerAt);
  writeBoxes(uppers.size(), offsetof(typename Bytes::UpperData, mBBox), upperAt);
  publishChildren<typename Bytes::UpperData>(
      lowers, [&](std::uint32_t n) -> auto& { return topology_.upper(n); },
      [&](std::size_t n) { return lowerAt(n).arena_offset; });
  writeEach(
      uppers.size(), sizeof(Tile), [&](std::size_t n) { return Bytes::kTiles + uppers[n].entry * sizeof(Tile); },
      [&](std::size_t n, std::byte* to) {
        Tile tile = {};
        const auto& [x, y, z] = upperAt(n).origin_ijk;
        tile.key = Bytes::RootData::CoordToKey(nanovdb::Coord(x, y, z));
        tile.child = static_cast<std::int64_t>(upperAt(n).arena_offset - Bytes::kRoot);
        std::memcpy(to, &tile, sizeof(tile));
      });
  if (!topology_.addedLeaves().empty() || !lowers.empty() || !uppers.empty()) {
    const std::uint32_t counts[3] = {topology_.leafCount(), topology_.lowerCount(), topology_.upperCount()};
    write(Bytes::kTree + offsetof(typename Bytes::TreeData, mNodeCount), counts, sizeof(counts));
  }
  if (!uppers.empty()) {
    const std::uint32_t table_size = topology_.upperCount();
    write(Bytes::kRoot + offsetof(typename Bytes::RootData, mTableSize), &table_size, sizeof(table_size));
  }
}

template <class Leaves>
template <class ParentData, class ParentOf, class OffsetOf>
void NanoMirror<Leaves>::Impl::publishChildren(const std::vector<AddedNode>& added, const ParentOf& parent_of,
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

template <class Leaves>
template <class OffsetOf, class Fill>
void NanoMirror<Leaves>::Impl::writeEach(std::size_t count, std::uint32_t bytes, const OffsetOf& offset_of,
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

template <class Leaves>
void NanoMirror<Leaves>::Impl::write(std::uint64_t offset, const void* source, std::uint64_t bytes) {
  arena_->write(offset, source, bytes);
  traffic_.bytes_written += bytes;
}

template <class Leaves>
NanoMirror<Leaves>::NanoMirror(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m,
                               std::uint32_t root_capacity, Leaves leaves) {
  if (!(voxel_size_m > 0 && std::isfinite(voxel_size_m))) {
    throw InvalidArgument("mirror.voxel_size_m", "", "The voxel size must be a positive number", "Give metres");
  }
  if (!(root_capacity >= 1 && root_capacity <= kMaxRootCapacity)) {
    throw InvalidArgument("mirror.root_capacity", "", "The mirror needs room for 1 to 65536 root tiles",
                          "Leave it at its default");
  }
  impl_ = std::make_unique<Impl>(std::move(arena), voxel_size_m, root_capacity, leaves);
}

template <class Leaves>
NanoMirror<Leaves>::~NanoMirror() = default;

template <class Leaves>
void NanoMirror<Leaves>::apply(std::span<const Change> changes) {
  impl_->applyLists({&changes, 1});
}
template <class Leaves>
void NanoMirror<Leaves>::applyLists(std::span<const std::span<const Change>> lists) {
  impl_->applyLists(lists);
}

template <class Leaves>
kernels::GridSpace NanoMirror<Leaves>::space() const {
  impl_->requireWhole();
  return impl_->topology_.space();
}
template <class Leaves>
void NanoMirror<Leaves>::reserve(std::uint64_t more_bytes) {
  impl_->reserve(more_bytes);
}
template <class Leaves>
void NanoMirror<Leaves>::adopt(const kernels::GridGrowth& growth) {
  impl_->adopt(growth);
}

template <class Leaves>
auto NanoMirror<Leaves>::grid() const noexcept -> const Grid* {
  return static_cast<const Grid*>(impl_->arena_->base());
}
template <class Leaves>
std::uint64_t NanoMirror<Leaves>::leafCount() const noexcept {
  return impl_->topology_.leafCount();
}
template <class Leaves>
std::uint32_t NanoMirror<Leaves>::rootTileCount() const noexcept {
  return impl_->topology_.upperCount();
}
template <class Leaves>
std::uint64_t NanoMirror<Leaves>::usedBytes() const noexcept {
  return impl_->topology_.usedBytes();
}
template <class Leaves>
std::uint64_t NanoMirror<Leaves>::committedBytes() const noexcept {
  return impl_->arena_->committedBytes();
}
template <class Leaves>
std::uint64_t NanoMirror<Leaves>::hostBytes() const noexcept {
  return impl_->topology_.hostBytes();
}
template <class Leaves>
const MirrorTraffic& NanoMirror<Leaves>::lastTraffic() const noexcept {
  return impl_->traffic_;
}

template class NanoMirror<OccupancyLeaves>;
template class NanoMirror<DistanceLeaves>;

}  // namespace accessvdb::internal
