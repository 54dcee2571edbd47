// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "change/gone_cells.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <numeric>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kHitsPerTask = 512;
/// After so many scans, cells in which nothing is left to open are no longer walked.
constexpr std::uint64_t kScansBetweenDrops = 16;

std::uint64_t blockOf(Pass pass) { return pass >> 9; }

}  // namespace

std::int32_t shadowCells(const TsdfParams& resolved) {
  return static_cast<std::int32_t>(std::ceil((resolved.truncation_distance_m / resolved.voxel_size_m + 1) / kCellEdge));
}

GoneCells::GoneCells(const PackedMap& map, const PointStore& points, const TsdfParams& resolved,
                     const std::optional<VoxelColumnBox>& core)
    : map_(map), points_(points), core_(core) {
  const double v = resolved.voxel_size_m, tau = resolved.truncation_distance_m / v, sigma = resolved.range_noise_m / v;
  shape_.voxel_size_m = v;
  shape_.margin = tau + 3 * sigma;
  shape_.line_step = std::max(0.125, sigma);
  shape_.shadow_cells = shadowCells(resolved);
}

Index3 GoneCells::cellAt(CellPlace place) const {
  const Index3& leaf = points_.index().blocks()[place.block].leaf;
  const auto half = [&place](int bit) { return static_cast<std::int32_t>(place.cell >> bit & 1); };
  return {2 * leaf[0] + half(2), 2 * leaf[1] + half(1), 2 * leaf[2] + half(0)};
}

/// Each block once: the points come leaf by leaf.
std::vector<GoneCells::BlockHits> GoneCells::hitsOf(std::span<const std::uint32_t> touched) const {
  std::vector<CellPlace> places(touched.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, touched.size(), kHitsPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const auto cell =
          static_cast<std::uint32_t>(cellOfBit(bitInParent(points_.voxelOf(points_.first_L(touched[n])))));
      places[n] = {points_.blockOf(touched[n]), cell};
    }
  });
  std::vector<BlockHits> hits;
  for (const CellPlace place : places) {
    if (hits.empty() || hits.back().block != place.block) hits.push_back({place.block, {}});
    std::uint8_t& count = hits.back().counts[place.cell];
    if (count < 0xff) ++count;
  }
  return hits;
}

/// @param visit  (CellPlace, count), from several threads, but for the cells of a block from one
template <typename Visit>
void GoneCells::forEachHit(const std::vector<BlockHits>& hits, const Visit& visit) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, hits.size(), kHitsPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      for (std::uint32_t cell = 0; cell < 8; ++cell) {
        if (hits[n].counts[cell] > 0) visit(CellPlace{hits[n].block, cell}, hits[n].counts[cell]);
      }
    }
  });
}

/// @param visit  (PassedBlocks&), from several threads
template <typename Visit>
void GoneCells::forEachPart(const Visit& visit) {
  tbb::parallel_for(std::size_t{0}, parts_.size(), [&](std::size_t n) { visit(parts_[n]); });
}

std::vector<OpenedLeaf> GoneCells::takeScan(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                            std::span<const std::uint32_t> touched) {
  count(p_L, q_L, touched);
  noteGone(judged());
  return endScan();
}

void GoneCells::catchUp(std::uint64_t scans) {
  const bool behind = scans / kScansBetweenDrops > scans_ / kScansBetweenDrops;
  scans_ = scans;
  if (behind) dropWhatIsDone();
}

void GoneCells::count(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                      std::span<const std::uint32_t> touched) {
  grow();
  ++scans_;
  // A hit of the same scan wins, so it revokes verdicts first.
  const std::vector<BlockHits> hit = hitsOf(touched);
  forEachHit(hit, [this](CellPlace place, std::uint32_t) {
    CellRecord& cell = at(place);
    if (cell.verdict == Verdict::Stands) return;
    cell.verdict = Verdict::Stands;
    refreshFlags(place);
  });
  evidence_ = evidenceOf(map_, points_, shape_, {blocks_, suspect_, opening_}, p_L, q_L);
  parts_ = byBlocks(evidence_.passes);
  changed_ = changed_ || !hit.empty() || !parts_.empty();
  forEachPart([this](PassedBlocks& part) { addPasses(part); });
  // With a hit, no cell is suspect, so no leaf is added to those that are.
  forEachHit(hit, [this](CellPlace place, std::uint32_t count) {
    at(place).addHits(count);
    refreshFlags(place);
  });
}

/// All counts before any verdict: verdicts do not depend on each other.
std::vector<Index3> GoneCells::judged() const {
  std::vector<std::vector<Index3>> by_part(parts_.size());
  tbb::parallel_for(std::size_t{0}, parts_.size(), [&](std::size_t n) {
    for (const CellPlace place : parts_[n].cells) {
      const Index3 cell = cellAt(place);
      if (isOurs(cell) && hasGone(place)) by_part[n].push_back(cell);
    }
  });
  std::vector<Index3> gone;
  for (const std::vector<Index3>& part : by_part) gone.insert(gone.end(), part.begin(), part.end());
  return gone;
}

void GoneCells::noteGone(std::span<const Index3> cells) {
  for (const Index3& cell : cells) {
    const std::uint32_t block = points_.index().blockAt({cell[0] >> 1, cell[1] >> 1, cell[2] >> 1});
    if (block == kNone) continue;  // of another tile
    const CellPlace place = {block, static_cast<std::uint32_t>(cellInLeaf(cell))};
    at(place).verdict = Verdict::Gone;
    gone_.push_back(place);
    walkAround(place);
    refreshFlags(place);
    changed_ = true;
  }
}

std::vector<OpenedLeaf> GoneCells::endScan() {
  forEachPart([this](PassedBlocks& part) {
    for (const CellPlace place : part.cells) {
      if (updateFlags(place)) part.suspect.push_back(points_.index().blocks()[place.block].leaf);
    }
  });
  for (const PassedBlocks& part : parts_) {
    for (const Index3& leaf : part.suspect) suspect_.add(leaf);
  }
  if (scans_ % kScansBetweenDrops == 0) dropWhatIsDone();
  parts_.clear();
  std::vector<OpenedLeaf> opened = std::move(std::exchange(evidence_, {}).opened);
  std::erase_if(opened, [this](const OpenedLeaf& leaf) {
    return core_ && !core_->contains({8 * leaf.leaf[0], 8 * leaf.leaf[1], 8 * leaf.leaf[2]});
  });
  return opened;
}

void GoneCells::noteRemoved(const VoxelSet& voxels) {
  grow();
  for (const LeafVoxels& part : voxels) {
    const openvdb::Coord& origin = part.origin_ijk;
    const std::uint32_t number = points_.index().blockAt({origin.x() >> 3, origin.y() >> 3, origin.z() >> 3});
    if (number == kNone) continue;
    const PackedLeaf* leaf = map_.tree().probeConstLeaf(origin);
    const LeafBits& occupied = points_.index().blocks()[number].occupied;
    const LeafBits collides = leaf == nullptr ? LeafBits{} : map_.collidingIn(*leaf);
    std::uint32_t removed = 0, left = 0;  // cells with such a point
    for (std::size_t word = 0; word < occupied.size(); ++word) {
      for (std::uint64_t bits = occupied[word]; bits != 0; bits &= bits - 1) {
        const std::uint64_t bit = bits & (~bits + 1);
        const std::uint32_t cell = 1u << cellOfBit(word << 6 | static_cast<std::size_t>(std::countr_zero(bits)));
        if ((part.bits[word] & bit) != 0) {
          removed |= cell;
        } else if ((collides[word] & bit) != 0) {
          left |= cell;
        }
      }
    }
    for (std::uint32_t cells = removed; cells != 0; cells &= cells - 1) {
      const CellPlace place = {number, static_cast<std::uint32_t>(std::countr_zero(cells))};
      CellRecord& cell = at(place);
      const Verdict before = cell.verdict;
      cell = {};
      if (before != Verdict::Stands || (left >> place.cell & 1) == 0) cell.verdict = Verdict::Gone;
      if (cell.verdict == Verdict::Gone && before != Verdict::Gone) gone_.push_back(place);
      if (cell.verdict == Verdict::Gone) walkAround(place);
      refreshFlags(place);
    }
  }
}

/// Cuts passes into parts that threads take: a block is in one of them.
std::vector<GoneCells::PassedBlocks> GoneCells::byBlocks(std::span<const Pass> passes) {
  constexpr std::size_t kPassesPerTask = 1024;
  std::vector<PassedBlocks> parts;
  for (std::size_t begin = 0, end = 0; begin < passes.size(); begin = end) {
    end = std::min(begin + kPassesPerTask, passes.size());
    while (end < passes.size() && blockOf(passes[end]) == blockOf(passes[end - 1])) ++end;
    parts.push_back({passes.subspan(begin, end - begin), {}, {}});
  }
  return parts;
}

void GoneCells::addPasses(PassedBlocks& passed) {
  constexpr std::uint32_t kSampledOneIn = 4;  // the rays that are examined in cells that are not suspect
  const std::span<const Pass> passes = passed.passes;
  for (std::size_t n = 0; n < passes.size();) {
    const std::uint64_t place = passes[n] >> 6;
    std::uint64_t lines = 0;
    for (; n < passes.size() && passes[n] >> 6 == place; ++n) lines |= std::uint64_t{1} << (passes[n] & 63);
    const CellPlace cell = {static_cast<std::uint32_t>(place / 8), static_cast<std::uint32_t>(place % 8)};
    const bool all_rays = (blocks_[cell.block].suspect >> cell.cell & 1) != 0;
    at(cell).addPasses(lines, all_rays ? 1 : kSampledOneIn);
    passed.cells.push_back(cell);
  }
}

/// Whether the evidence is enough: the cell's own, or that of its neighbours, too.
bool GoneCells::hasGone(CellPlace place) const {
  const CellRecord& own = blocks_[place.block].cells[place.cell];
  if (own.verdict != Verdict::Stands || own.scans < GoneRule::kScans) return false;
  if (GoneRule::isEnough(GoneRule::kFactor, own.passes(), own.hits, own.missed)) return true;
  std::uint64_t passes = 0, hits = 0, missed = 0;
  const Index3 middle = cellAt(place);
  Index3 cell;
  for (cell[0] = middle[0] - 1; cell[0] <= middle[0] + 1; ++cell[0]) {
    for (cell[1] = middle[1] - 1; cell[1] <= middle[1] + 1; ++cell[1]) {
      for (cell[2] = middle[2] - 1; cell[2] <= middle[2] + 1; ++cell[2]) {
        const std::uint32_t block = points_.index().blockAt({cell[0] >> 1, cell[1] >> 1, cell[2] >> 1});
        if (block == kNone) continue;
        const CellRecord& record = blocks_[block].cells[cellInLeaf(cell)];
        if (record.hits > 0 && record.passes() == 0) return false;  // hit, and not passed since
        passes += record.passes();
        hits += record.hits;
        missed += record.missed;
      }
    }
  }
  return GoneRule::isEnough(GoneRule::kPooledFactor, passes, hits, missed);
}

/// What the walk sees of a cell at a glance. @return whether its leaf is new among the suspect ones
bool GoneCells::updateFlags(CellPlace place) {
  BlockCells& block = blocks_[place.block];
  const CellRecord& cell = block.cells[place.cell];
  const auto bit = static_cast<std::uint8_t>(1u << place.cell);
  const bool suspect = GoneRule::isSuspect(cell);
  const bool is_first = suspect && block.suspect == 0;
  block.suspect = static_cast<std::uint8_t>(suspect ? block.suspect | bit : block.suspect & ~bit);
  block.gone = static_cast<std::uint8_t>(cell.verdict != Verdict::Stands ? block.gone | bit : block.gone & ~bit);
  return is_first;
}

void GoneCells::refreshFlags(CellPlace place) {
  if (updateFlags(place)) suspect_.add(points_.index().blocks()[place.block].leaf);
}

/// Rays may open voxels in the leaves around a cell that has gone.
void GoneCells::walkAround(CellPlace place) {
  const Index3 cell = cellAt(place);
  const std::int32_t reach = shape_.shadow_cells;
  Index3 leaf;
  for (leaf[0] = (cell[0] - reach) >> 1; leaf[0] <= (cell[0] + reach) >> 1; ++leaf[0]) {
    for (leaf[1] = (cell[1] - reach) >> 1; leaf[1] <= (cell[1] + reach) >> 1; ++leaf[1]) {
      for (leaf[2] = (cell[2] - reach) >> 1; leaf[2] <= (cell[2] + reach) >> 1; ++leaf[2]) opening_.add(leaf);
    }
  }
}

/// Cells with nothing left to open around them are walked no more. Also forgets leaves that are no longer suspect.
void GoneCells::dropWhatIsDone() {
  OpenCells open(map_, points_, shape_, {blocks_, suspect_, opening_});
  const auto isDone = [&](CellPlace place) {
    const Index3 middle = cellAt(place);
    const std::int32_t reach = shape_.shadow_cells;
    Index3 leaf;
    for (leaf[0] = (middle[0] - reach) >> 1; leaf[0] <= (middle[0] + reach) >> 1; ++leaf[0]) {
      for (leaf[1] = (middle[1] - reach) >> 1; leaf[1] <= (middle[1] + reach) >> 1; ++leaf[1]) {
        for (leaf[2] = (middle[2] - reach) >> 1; leaf[2] <= (middle[2] + reach) >> 1; ++leaf[2]) {
          const PackedLeaf* of_map = map_.tree().probeConstLeaf({8 * leaf[0], 8 * leaf[1], 8 * leaf[2]});
          if (of_map == nullptr || !LeafValues(*of_map)) continue;
          const LeafBits collides = map_.collidingIn(*of_map);
          std::uint32_t cells = 0;
          for (std::size_t bit = 0; bit < 512; ++bit) {
            if ((collides[bit >> 6] >> (bit & 63) & 1) != 0) cells |= 1u << cellOfBit(bit);
          }
          for (std::uint32_t n = 0; n < 8; ++n) {
            if ((cells >> n & 1) == 0) continue;
            const auto half = [n](int b) { return static_cast<std::int32_t>(n >> b & 1); };
            if (open.mayOpen({2 * leaf[0] + half(2), 2 * leaf[1] + half(1), 2 * leaf[2] + half(0)})) return false;
          }
        }
      }
    }
    return true;
  };
  std::erase_if(gone_, [this](CellPlace place) { return at(place).verdict != Verdict::Gone; });
  std::vector<CellPlace> done;
  for (const CellPlace place : gone_) {
    if (isOurs(cellAt(place)) && isDone(place)) done.push_back(place);
  }
  for (const CellPlace place : done) setOpen(place);
  std::erase_if(gone_, [this](CellPlace place) { return at(place).verdict != Verdict::Gone; });
  opening_.clear();
  for (const CellPlace place : gone_) walkAround(place);
  std::vector<Index3> suspect;
  suspect_.forEach([&](const Index3& leaf) {
    if (blocks_[points_.index().blockAt(leaf)].suspect != 0) suspect.push_back(leaf);
  });
  suspect_.clear();
  for (const Index3& leaf : suspect) suspect_.add(leaf);
}

void GoneCells::setOpen(CellPlace place) {
  at(place).verdict = Verdict::Open;
  changed_ = true;
}

std::vector<std::uint32_t> GoneCells::blocksInOrder() const {
  std::vector<std::uint32_t> order(blocks_.size());
  std::iota(order.begin(), order.end(), 0u);
  const ChunkedArray<PointBlock>& blocks = points_.index().blocks();
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return blocks[a].leaf < blocks[b].leaf; });
  return order;
}

bool GoneCells::restore(const Index3& leaf, const LeafCells& cells) {
  grow();
  const std::uint32_t block = points_.index().blockAt(leaf);
  if (block == kNone || blocks_[block].cells != LeafCells{}) return false;
  blocks_[block].cells = cells;
  for (std::uint32_t n = 0; n < 8; ++n) {
    const CellPlace place = {block, n};
    const CellRecord& cell = at(place);
    if (cell.verdict > Verdict::Open ||
        std::max({cell.hits, cell.missed, cell.emptied, cell.followed}) > CellRecord::kMost) {
      return false;
    }
    if (cell.verdict == Verdict::Gone) {
      gone_.push_back(place);
      walkAround(place);
    }
    refreshFlags(place);
  }
  return true;
}

std::optional<Verdict> GoneCells::verdictAt(const Index3& voxel) const {
  const std::uint32_t block = points_.index().blockAt(parentOf(voxel));
  if (block == kNone || block >= blocks_.size()) return std::nullopt;
  const CellRecord& cell = blocks_[block].cells[cellOfBit(bitInParent(voxel))];
  if (cell.hits == 0) return std::nullopt;
  return cell.verdict;
}

std::uint64_t GoneCells::bytes() const {
  return blocks_.bytes() + suspect_.bytes() + opening_.bytes() + gone_.capacity() * sizeof(CellPlace);
}

std::vector<LeafChange> openVoxels(PackedMap& map, std::span<const OpenedLeaf> opened) {
  VoxelSet voxels;
  for (const auto& [leaf, bits] : opened) {
    const openvdb::Coord origin(8 * leaf[0], 8 * leaf[1], 8 * leaf[2]);
    // A tile need not have everything that another opens beyond its reach.
    const PackedLeaf* of_map = map.tree().probeConstLeaf(origin);
    if (of_map != nullptr && LeafValues(*of_map)) voxels.push_back({origin, bits});
  }
  return removeAsFree(map, voxels);
}

}  // namespace accessvdb::internal
