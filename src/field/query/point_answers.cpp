// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Positions against the authored map and the surface points.
///
/// Bound by memory latency: each answer needs a voxel, a block of points, a few positions and their state, scattered
/// over gigabytes. So positions go through in groups, one stage at a time, and each stage prefetches what the next one
/// reads. Nothing is sorted.
#include <array>
#include <bit>
#include <cmath>

#include "field/query/query_source.h"
#include "hostdev/capsule.h"
#include "hostdev/position_voxel.h"
#include "processor/prefetch.h"

namespace accessvdb::internal {
namespace {

using Block = QueryIndex::Block;

constexpr std::size_t kGroup = 32;
constexpr int kReach = kPointRadiusVoxels;
/// From a voxel's centre to its faces, plus the error of float32 coordinates at 10^6 voxels from the origin.
constexpr float kCellHalf = 0.5f + 0.07f;

/// What a position needs, as far as it is known.
struct Visit {
  Eigen::Vector3d p_L;
  double distance_m;
  const PackedLowerNode* lower;
  const PackedLeaf* leaf;
  LeafValues values;
  const QueryIndex::LeafGroup* leaf_group;  ///< the leaf group of its own block
  const Block* own;                         ///< its own block
  const QueryIndex::Entry* point;           ///< the point that answers
  std::array<const Block*, 8> blocks;       ///< those within reach, if its voxel has no point
  Index3 voxel;
  int block_count;
  bool inside;
};

/// Looks up the leaf groups of point blocks, mostly that of the last call.
class LeafGroupCache {
 public:
  explicit LeafGroupCache(const QueryIndex& index) : index_(index) {}
  const QueryIndex::LeafGroup* at(const Index3& leaf_group) {
    if (leaf_group != key_) {
      key_ = leaf_group;
      leaf_group_ = index_.leafGroupAt(leaf_group);
    }
    return leaf_group_;
  }

 private:
  const QueryIndex& index_;
  Index3 key_ = {1 << 30, 0, 0};  // no leaf group
  const QueryIndex::LeafGroup* leaf_group_ = nullptr;
};

class Answerer {
 public:
  explicit Answerer(const QuerySource& source)
      : source_(source), blocks_(source.index->blocks()), map_(source.map->tree()), leaf_groups_(*source.index) {}

  void answer(std::span<const Eigen::Vector3d> points_W, std::span<PointAnswer> answers) {
    const std::size_t count = points_W.size();
    for (std::size_t n = 0; n < count; ++n) locate(points_W[n], group_[n]);
    for (std::size_t n = 0; n < count; ++n) findNodes(group_[n]);
    for (std::size_t n = 0; n < count; ++n) findVoxels(group_[n]);
    for (std::size_t n = 0; n < count; ++n) findOwnPoint(group_[n]);
    for (std::size_t n = 0; n < count; ++n) findPoint(group_[n]);
    for (std::size_t n = 0; n < count; ++n) answers[n] = answerOf(group_[n]);
  }

 private:
  static openvdb::Coord coordOf(const Visit& visit) { return {visit.voxel[0], visit.voxel[1], visit.voxel[2]}; }

  void locate(const Eigen::Vector3d& p_W, Visit& visit) {
    visit.p_L = p_W - source_.origin_W;
    visit.lower = nullptr;
    visit.leaf = nullptr;
    visit.values = {};
    visit.leaf_group = nullptr;
    visit.own = nullptr;
    visit.point = nullptr;
    visit.block_count = 0;
    visit.inside = kernels::hasVoxel(visit.p_L.data(), source_.inverse_voxel_size);
    if (!visit.inside) return;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double x_m = visit.p_L[static_cast<Eigen::Index>(axis)];
      visit.voxel[axis] = static_cast<std::int32_t>(kernels::voxelOfCoordinate(x_m, source_.inverse_voxel_size));
    }
    const Index3 leaf = parentOf(visit.voxel);
    if ((visit.leaf_group = leaf_groups_.at(parentOf(leaf))) != nullptr) {
      prefetchRead(&visit.leaf_group->present);
      prefetchRead(visit.leaf_group->block + bitInParent(leaf));
    }
    if ((visit.lower = map_.probeConstNode<PackedLowerNode>(coordOf(visit))) != nullptr) {
      const openvdb::Index n = PackedLowerNode::coordToOffset(coordOf(visit));
      prefetchRead(visit.lower->getTable() + n);
      prefetchRead(reinterpret_cast<const char*>(&visit.lower->getChildMask()) + n / 8);
    }
  }

  void findNodes(Visit& visit) {
    if (visit.lower != nullptr) {
      const openvdb::Index n = PackedLowerNode::coordToOffset(coordOf(visit));
      if (visit.lower->isChildMaskOn(n)) {
        visit.leaf = visit.lower->getTable()[n].getChild();
        prefetchRead(visit.leaf, sizeof(PackedLeaf));
      }
    }
    if (visit.leaf_group != nullptr) {
      const std::size_t bit = bitInParent(parentOf(visit.voxel));
      if (visit.leaf_group->has(bit)) {
        visit.own = &blocks_[visit.leaf_group->block[bit]];
        prefetchRead(visit.own, sizeof(Block));
      }
    }
  }

  void findVoxels(Visit& visit) {
    if (visit.leaf != nullptr) {
      visit.values = LeafValues(*visit.leaf);
      if (visit.values) visit.values.prefetch(PackedLeaf::coordToOffset(coordOf(visit)));
    }
    if (visit.own != nullptr) {
      const std::size_t bit = bitInParent(visit.voxel);
      if (visit.own->has(bit)) {
        visit.point = &visit.own->at(bit);
        prefetchRead(visit.point);
        return;
      }
    }
    if (visit.inside) findBlocks(visit);
  }

  /// At most eight blocks within reach of the position.
  void findBlocks(Visit& visit) {
    Index3 low, high, leaf;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = (visit.voxel[axis] - kReach) >> 3;
      high[axis] = (visit.voxel[axis] + kReach) >> 3;
    }
    if (parentOf(low) == parentOf(high)) {
      if (visit.leaf_group != nullptr) findBlocksIn(*visit.leaf_group, low, high, visit);
      return;
    }
    for (leaf[0] = low[0]; leaf[0] <= high[0]; ++leaf[0]) {
      for (leaf[1] = low[1]; leaf[1] <= high[1]; ++leaf[1]) {
        for (leaf[2] = low[2]; leaf[2] <= high[2]; ++leaf[2]) {
          const QueryIndex::LeafGroup* leaf_group = leaf_groups_.at(parentOf(leaf));
          const std::size_t bit = bitInParent(leaf);
          if (leaf_group != nullptr && leaf_group->has(bit)) takeBlock(leaf_group->block[bit], visit);
        }
      }
    }
  }

  void takeBlock(std::uint32_t index, Visit& visit) const {
    const Block* block = &blocks_[index];
    visit.blocks[static_cast<std::size_t>(visit.block_count++)] = block;
    prefetchRead(block, sizeof(Block));
  }

  /// The same if one leaf group contains them all, as is usual: rows of its bits.
  void findBlocksIn(const QueryIndex::LeafGroup& leaf_group, const Index3& low, const Index3& high,
                    Visit& visit) const {
    const std::uint32_t row_mask = (0xffu << (low[2] & 7)) & (0xffu >> (7 - (high[2] & 7)));
    for (std::int32_t x = low[0]; x <= high[0]; ++x) {
      const std::uint64_t word = leaf_group.present[static_cast<std::size_t>(x & 7)];
      for (std::int32_t y = low[1]; y <= high[1]; ++y) {
        const int row = (y & 7) * 8;
        for (auto bits = static_cast<std::uint32_t>(word >> row) & row_mask; bits != 0; bits &= bits - 1) {
          takeBlock(leaf_group.block[(x & 7) * 64 + row + std::countr_zero(bits)], visit);
        }
      }
    }
  }

  void findOwnPoint(Visit& visit) {
    if (visit.point != nullptr) prefetchState(visit.point->id);
    for (int n = 0; n < visit.block_count; ++n) prefetchRead(visit.blocks[static_cast<std::size_t>(n)]->entries.data());
  }

  void findPoint(Visit& visit) {
    if (visit.point != nullptr) {
      visit.distance_m = std::sqrt(squaredDistance(*visit.point, visit));
      return;
    }
    if (visit.block_count > 0) keepBlocksWithin(visit);
    if (visit.block_count > 0) {
      NearestSearch(source_, visit).run();
      if (visit.point != nullptr) prefetchState(visit.point->id);
    }
  }

  void prefetchState(std::uint32_t id) const {
    if (id >= source_.state->size) return;
    prefetchRead(source_.state->label + id);
    prefetchRead(source_.state->reason + id);
    prefetchRead(source_.state->score + id);
    prefetchRead(source_.state->direction + id);
  }

  static double squaredDistance(const QueryIndex::Entry& entry, const Visit& visit) {
    double sum = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double e = static_cast<double>(entry.position_L[axis]) - visit.p_L[axis];
      sum += e * e;
    }
    return sum;
  }

  /// Bits of the y and z of a slice that are within `reach` of (y, z), which may be outside the block.
  static std::uint64_t boxMask(int y, int z, int reach) {
    const int y0 = std::max(0, y - reach), y1 = std::min(7, y + reach);
    const int z0 = std::max(0, z - reach), z1 = std::min(7, z + reach);
    if (y0 > y1 || z0 > z1) return 0;
    const std::uint64_t row = (0xffu << z0) & (0xffu >> (7 - z1));
    return row * 0x0101010101010101u & (~std::uint64_t{0} << (8 * y0)) & (~std::uint64_t{0} >> (8 * (7 - y1)));
  }

  /// Most positions that have blocks around them still have no point within reach.
  static void keepBlocksWithin(Visit& visit) {
    int kept = 0;
    for (int n = 0; n < visit.block_count; ++n) {
      const Block& block = *visit.blocks[static_cast<std::size_t>(n)];
      const int cx = visit.voxel[0] - block.leaf[0] * 8;
      std::uint64_t any = 0;
      for (int x = std::max(0, cx - kReach); x <= std::min(7, cx + kReach); ++x) {
        any |= block.occupied[static_cast<std::size_t>(x)];
      }
      any &= boxMask(visit.voxel[1] - block.leaf[1] * 8, visit.voxel[2] - block.leaf[2] * 8, kReach);
      if (any != 0) visit.blocks[static_cast<std::size_t>(kept++)] = &block;
    }
    visit.block_count = kept;
  }

  /// Nearest point within reach. Searches outwards in shells of voxels around the position's own, and stops when a
  /// shell cannot contain a nearer one. Inside a shell, the most promising voxel is read first; the points of the
  /// others are read only if their voxels come nearer than the best.
  class NearestSearch {
   public:
    NearestSearch(const QuerySource& source, Visit& visit) : source_(source), visit_(visit) {
      const double limit_m = kReach * static_cast<double>(source.voxel_size_m);
      best2_m2_ = limit_m * limit_m;
      limit2_ = kReach * kReach * kWiden;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto p = static_cast<float>(visit.p_L[static_cast<Eigen::Index>(axis)] *
                                              static_cast<double>(source.inverse_voxel_size) -
                                          visit.voxel[axis]);
        off_centre_ = std::max(off_centre_, std::abs(p));
        for (int offset = -kReach; offset <= kReach; ++offset) {
          const float least = std::max(0.0f, std::abs(static_cast<float>(offset) - p) - kCellHalf);
          least2_[axis][static_cast<std::size_t>(offset + kReach)] = least * least;
        }
      }
    }

    void run() {
      for (int shell = 1; shell <= kReach; ++shell) {
        const float least = static_cast<float>(shell) - kCellHalf - off_centre_;
        if (least > 0 && least * least > limit2_) break;
        count_ = 0;
        for (int n = 0; n < visit_.block_count; ++n) gather(*visit_.blocks[static_cast<std::size_t>(n)], shell);
        if (count_ == 0) continue;
        std::size_t first = 0;
        for (std::size_t n = 1; n < count_; ++n) {
          if (candidates_[n].least2 < candidates_[first].least2) first = n;
        }
        tryPoint(candidates_[first]);
        for (std::size_t n = 0; n < count_; ++n) {
          if (n != first && candidates_[n].least2 <= limit2_) tryPoint(candidates_[n]);
        }
      }
      if (visit_.point != nullptr) visit_.distance_m = std::sqrt(best2_m2_);
    }

   private:
    struct Candidate {
      float least2;              ///< its point is no nearer than the root of this, voxels
      std::uint16_t bit, order;  ///< the voxel's in the block; ascending in x, y, z
      const Block* block;
    };
    static constexpr std::size_t kMostInShell = 7 * 7 * 7 - 5 * 5 * 5;
    static_assert(kReach == 3);
    static constexpr float kWiden = 1.001f;  // covers float32's error

    void gather(const Block& block, int shell) {
      const int cx = visit_.voxel[0] - block.leaf[0] * 8, cy = visit_.voxel[1] - block.leaf[1] * 8,
                cz = visit_.voxel[2] - block.leaf[2] * 8;
      const std::uint64_t outer = boxMask(cy, cz, shell);
      if (outer == 0) return;
      const std::uint64_t ring = outer & ~boxMask(cy, cz, shell - 1);
      for (int x = std::max(0, cx - shell); x <= std::min(7, cx + shell); ++x) {
        const std::uint64_t word = block.occupied[static_cast<std::size_t>(x)];
        const bool face = x == cx - shell || x == cx + shell;
        for (std::uint64_t bits = word & (face ? outer : ring); bits != 0; bits &= bits - 1) {
          const int bit = std::countr_zero(bits);
          const int dx = x - cx + kReach, dy = (bit >> 3) - cy + kReach, dz = (bit & 7) - cz + kReach;
          const float least2 = least2_[0][static_cast<std::size_t>(dx)] + least2_[1][static_cast<std::size_t>(dy)] +
                               least2_[2][static_cast<std::size_t>(dz)];
          if (least2 > limit2_) continue;
          candidates_[count_++] = {least2, static_cast<std::uint16_t>(x * 64 + bit),
                                   static_cast<std::uint16_t>(dx * 64 + dy * 8 + dz), &block};
        }
      }
    }

    void tryPoint(const Candidate& candidate) {
      const QueryIndex::Entry& entry = candidate.block->at(candidate.bit);
      const double distance2_m2 = squaredDistance(entry, visit_);
      if (distance2_m2 > best2_m2_) return;
      if (distance2_m2 == best2_m2_ && visit_.point != nullptr && candidate.order < order_) return;
      best2_m2_ = distance2_m2;
      order_ = candidate.order;
      visit_.point = &entry;
      limit2_ = static_cast<float>(distance2_m2) * source_.inverse_voxel_size * source_.inverse_voxel_size * kWiden;
    }

    const QuerySource& source_;
    Visit& visit_;
    std::size_t count_ = 0;
    double best2_m2_;
    float limit2_, off_centre_ = 0;
    std::uint16_t order_ = 0;
    float least2_[3][2 * kReach + 1];
    std::array<Candidate, kMostInShell> candidates_;
  };

  [[nodiscard]] PointAnswer answerOf(const Visit& visit) const {
    PointAnswer answer;
    if (visit.leaf != nullptr) {
      answer.cleared = source_.map->isKnownFree(*visit.leaf, PackedLeaf::coordToOffset(coordOf(visit)));
    }
    const std::uint32_t packed = visit.values ? visit.values[PackedLeaf::coordToOffset(coordOf(visit))] : 0;
    answer.weight = static_cast<std::uint16_t>(weightOf(packed));
    if (answer.weight > 0) {
      const VoxelVotes* votes = source_.map->votesOf(*visit.leaf);
      const bool blocked = votes != nullptr && votes->blockedAt(PackedLeaf::coordToOffset(coordOf(visit)));
      answer.distance_m = blocked ? 0 : source_.map->distanceOf(meanOf(packed));
    }
    answer.unknown = answer.weight == 0 && !answer.cleared;
    // Where free space ages, what is far from every surface but was not confirmed for long is unknown again.
    if (answer.weight > 0 && !answer.cleared && source_.map->agesFreeSpace()) {
      answer.unknown = answer.distance_m >= source_.map->distanceOf(source_.map->collisionMean());
    }
    if (visit.point == nullptr) return answer;
    const std::uint32_t id = visit.point->id;
    answer.point_id = id;
    answer.point_distance_m = static_cast<float>(visit.distance_m);
    const HostPointState& state = *source_.state;
    if (id >= state.size) return answer;  // added after the last update
    answer.label = state.label[id];
    answer.reason = state.reason[id];
    answer.score = state.score[id];
    answer.direction = state.direction[id];
    if (answer.direction < source_.directions.size()) answer.direction_W = source_.directions[answer.direction];
    return answer;
  }

  const QuerySource& source_;
  const std::vector<Block>& blocks_;
  ConstPackedAccessor map_;
  LeafGroupCache leaf_groups_;
  std::array<Visit, kGroup> group_;
};

}  // namespace

void answerPoints(const QuerySource& source, std::span<const Eigen::Vector3d> points_W,
                  std::span<PointAnswer> answers) {
  Answerer answerer(source);
  for (std::size_t n = 0; n < points_W.size(); n += kGroup) {
    const std::size_t count = std::min(kGroup, points_W.size() - n);
    answerer.answer(points_W.subspan(n, count), answers.subspan(n, count));
  }
}

}  // namespace accessvdb::internal
