// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the kernels of an update read and write. Each owner of arrays hands out one of these views; a kernel takes the
/// ones it needs.
#pragma once

#include <cstdint>

#include "cuda/memory/device_list.h"
#include "cuda/search/busy_map.h"
#include "cuda/search/hash_view.cuh"
#include "hostdev/due_rule.h"
#include "hostdev/kept_neighbours.h"
#include "hostdev/known_counts.h"
#include "hostdev/known_levels.h"
#include "hostdev/known_slots.h"
#include "hostdev/neighbour_rule.h"
#include "hostdev/point_update.h"
#include "hostdev/surface_choice.h"
#include "hostdev/views.h"
#include "launch/exact_updater.h"

namespace accessvdb::kernels {

// Counters that kernels add to, by who adds.

/// Counts of what was evaluated.
struct OutcomeCounters {
  unsigned long long tests, scored, label_changes, evaluated;
};
/// Counts of the points whose neighbourhoods may have changed.
struct MovedCounters {
  std::uint32_t moved, touched_blocks, reached_blocks, failed, prepared;
  std::uint32_t moved_blocks;      ///< length of MovedView::blocks
  std::uint32_t next_block, left;  ///< of one search through them: the next one, and points left over
  std::uint32_t touched, touched_new;
  /// Whether most touched points were there before: else hardly any neighbourhood has the same points as before.
  [[nodiscard]] ACCESSVDB_HOSTDEV bool mostlyKnown() const { return 2 * touched_new <= touched; }
};
/// State of one search.
struct SearchCounters {
  std::uint32_t due, busy, ordered, whole, whole_at_first, next_whole, next_some, next_added;
  std::uint32_t near_flips;  ///< points that were numbered
};
/// Counts of the mirror's lower nodes.
struct MirrorCounters {
  std::uint32_t lowers, listed_lowers;
};
struct UpdateCounters {
  OutcomeCounters outcome;
  MovedCounters moved;
  SearchCounters search;
  MirrorCounters mirror;
  std::uint32_t flip_tiles;
  std::uint32_t resolved;  ///< points that lend their direction under the paper's policy
};

#if defined(__CUDACC__)
/// Whether a point is marked. @param bits  [n / 32] by id
[[nodiscard]] __device__ inline bool isSet(const std::uint32_t* bits, std::uint32_t id) {
  return (bits[id >> 5] >> (id & 31) & 1u) != 0;
}
#endif

// PointTables: the points, what lies where, and what neighbourhoods are made of.

/// Points by leaf of the map.
struct BlockIndexView {
  HashView hash;
  std::uint32_t* block_at = nullptr;  ///< [slots of the hash]
  std::int32_t* leaf = nullptr;       ///< [3 blocks] voxel index >> 3
  std::uint32_t* first = nullptr;     ///< [blocks] ids of a block: ids[first .. first + count)
  std::uint32_t* count = nullptr;     ///< [blocks]
  std::uint32_t* ids = nullptr;
  float* reach_m = nullptr;  ///< [blocks] largest reach of its points; negative if none has a neighbourhood
  std::uint32_t blocks = 0;

#if defined(__CUDACC__)
  [[nodiscard]] __device__ std::uint32_t find(std::int32_t x, std::int32_t y, std::int32_t z) const {
    const std::uint32_t slot = hash.find(placeKey(x, y, z));
    return slot == kNoIndex ? kNoIndex : block_at[slot];
  }
#endif
};

/// Groups of blocks (NeighbourTables::group_log2).
struct GroupsView {
  int log2 = 0;
  std::uint32_t* of_block = nullptr;    ///< [blocks]
  std::int32_t* leaf = nullptr;         ///< [3 groups] the first leaf: lowest in x, y and z
  std::uint8_t* with_points = nullptr;  ///< [groups] 1: one of its points has or had a neighbourhood
  std::uint32_t groups = 0;
};

/// What neighbourhoods are made of, by id.
struct NeighbourStateView {
  std::uint32_t* block = nullptr;     ///< [n]
  float* mean_L = nullptr;            ///< [3 n]
  float* to_sensor_L = nullptr;       ///< [3 n]
  std::uint64_t* own_seen = nullptr;  ///< [words n]
  float* reach_m = nullptr;           ///< [n] negative: no neighbourhood yet
  KeptNeighbours* kept = nullptr;     ///< [n] null: nothing is kept
};

/// Constants of neighbourhoods.
struct NeighbourRuleView {
  float voxel_size_m = 0;
  double inverse_voxel_size = 0, steps_per_m = 0;
  std::int64_t radius_squared = 0;
  int neighbours = 0, view_neighbours = 0;
};

struct PointsView {
  PointStateView points;
  NeighbourStateView state;
  BlockIndexView index;
  GroupsView groups;
  NeighbourRuleView rule;
  std::uint32_t num_points = 0;

#if defined(__CUDACC__)
  [[nodiscard]] __device__ std::uint32_t groupOf(std::uint32_t id) const { return groups.of_block[state.block[id]]; }
  [[nodiscard]] __device__ const float* meanOf(std::uint32_t id) const {
    return state.mean_L + 3 * static_cast<std::size_t>(id);
  }
#endif
};

// CompetitionTables: what decides which points are scored, if not all are.

struct CompetitionView {
  SurfaceChoice choice;
  float reach_voxels = 0;                   ///< SurfaceChoice::reachVoxels()
  float inverse_voxel_size = 0;             ///< VoxelScale::inverse_float32
  std::uint32_t* returns = nullptr;         ///< [n]
  std::uint64_t* touched_voxels = nullptr;  ///< [8 blocks] bits as in BoxInLeaf
};

// MovedTables: points whose neighbourhoods may have changed.

/// Where a touched point was and is.
struct TouchedPlace {
  float now_L[3], before_L[3];  ///< before: NaN if the point is new
  std::uint32_t next;           ///< next in the same block, or kNoIndex
  std::uint32_t id;
};
/// Touched points by block.
struct PlacesView {
  TouchedPlace* places = nullptr;
  std::uint32_t* head = nullptr;            ///< [blocks] kNoIndex if nothing was touched
  std::uint32_t* touched_blocks = nullptr;  ///< blocks with a head
  std::uint32_t* reached_bits = nullptr;    ///< [blocks / 32]
  std::uint32_t* reached_blocks = nullptr;
};
/// Most points in a block, one per voxel.
inline constexpr std::uint32_t kMostInBlock = 512;
/// Moved points of one block: `count` items of the list, from `first` on.
struct MovedBlock {
  std::uint32_t first = 0, count = 0;
};
struct MovedView {
  PlacesView places;
  std::uint32_t* ids = nullptr;           ///< list of moved points
  std::uint32_t* bits = nullptr;          ///< [n / 32] already on that list
  MovedBlock* blocks = nullptr;           ///< [blocks] of the points near touched ones
  std::uint32_t* changed_bits = nullptr;  ///< [n / 32] already handed on for evaluation
  MovedCounters* counters = nullptr;
};

/// Points [first, first + count) of a list on the device.
struct PointChunk {
  const std::uint32_t* ids = nullptr;
  const std::uint32_t* length = nullptr;  ///< of the list; items beyond are skipped. Null: the list is long enough
  std::uint32_t first = 0, count = 0;

#if defined(__CUDACC__)
  [[nodiscard]] __device__ bool holds(std::uint32_t n) const {
    return n < count && (length == nullptr || first + n < *length);
  }
#endif
};

/// What the nearest points of a moved point add up to.
struct FoundNeighbours {
  NeighbourSums sums;
  std::int64_t farthest;
  DirectionMask seen;
};
/// The neighbourhood made from that.
struct FoundNeighbourhood {
  float normal[3];
  float reach_m;
  DirectionMask seen;
};
/// Moved points [begin, end) of the list, and where their neighbourhoods go.
struct MovedRange {
  /// FoundNeighbourhood::reach_m of those that launchTakeOverKept leaves; where they are not mostlyKnown(), it leaves
  /// all.
  static constexpr float kSearched = -1;
  std::uint32_t begin = 0, end = 0;
  FoundNeighbourhood* to = nullptr;  ///< [end - begin]
  std::uint32_t* left = nullptr;     ///< [end - begin] out: those of them that are left over
};

// FlipTables: what flips mean for groups of blocks.

/// A flipped leaf of a column, and the next one.
struct FlipLink {
  std::uint32_t next;  ///< list entry, or kNoIndex
  std::int32_t z;      ///< of the leaf
};
/// Flipped leaves in tiles of 8 x 8 columns. A column has 16 leaves above each other: one bit each, 16 bits per kind.
struct FlipsView {
  static constexpr int kTileLog2 = 3;
  static constexpr std::uint32_t kColumns = 64;  ///< columns per tile
  static constexpr std::uint32_t kLayers = 17;   ///< of a tile, with one for the end
  HashView hash;                                 ///< key: tile x >> 3, y >> 3, z >> 4
  std::uint32_t* tile_at = nullptr;              ///< [slots of the hash]
  std::uint64_t* occupied = nullptr;             ///< [tiles] columns with a flip, one bit each
  std::uint64_t* kinds = nullptr;                ///< [64 tiles]
  std::uint32_t* head = nullptr;                 ///< [64 tiles] first list entry in which voxels stopped colliding
  FlipLink* links = nullptr;                     ///< [list]
  std::uint32_t* arm_head = nullptr;             ///< the same for leaves in which voxels became free for a corridor
  FlipLink* arm_links = nullptr;
  const LeafFlips* list = nullptr;
  const std::uint16_t* voxels = nullptr;  ///< FlipLists::voxels
  /// The same voxels, those of a tile next to each other, and in it layer of leaves by layer: TileVoxel::code.
  std::uint32_t* by_layer = nullptr;
  std::uint32_t* layer_begin = nullptr;  ///< [17 tiles]

#if defined(__CUDACC__)
  /// Key of the tile that a leaf lies in. @param leaf  voxel index >> 3
  [[nodiscard]] static __device__ std::uint64_t keyOf(const std::int32_t* leaf) {
    return placeKey(leaf[0] >> kTileLog2, leaf[1] >> kTileLog2, leaf[2] >> 4);
  }
#endif
};

/// A flipped voxel in its tile.
struct TileVoxel {
  /// @param x, y, z  in the tile
  [[nodiscard]] ACCESSVDB_HOSTDEV static std::uint32_t code(std::uint32_t x, std::uint32_t y, std::uint32_t z,
                                                            bool collides) {
    return x << 14 | y << 8 | z << 1 | (collides ? 1u : 0u);
  }
};
struct GroupMasksView {
  GroupMasks* masks = nullptr;       ///< [groups]
  std::uint8_t* affected = nullptr;  ///< [groups] its masks are not empty; null: no flips at all
  /// [n / 32] accessible points whose best direction's corridor may have become blocked; null: worse_arm says which.
  std::uint32_t* arm_bits = nullptr;
};

// FootprintTable: what the tool and the corridor read.

/// The columns of both footprints at one horizontal offset: index + 1; 0: none.
struct FootprintPlace {
  std::uint32_t tool = 0, arm = 0;
};
struct FootprintView {
  const FootprintColumn* tool = nullptr;
  const FootprintColumn* arm = nullptr;
  const FootprintPlace* places = nullptr;  ///< [x][y] of the box; of several columns, the lowest
  /// [x][y] how many columns of one leaf each follow each other upwards. Null: there is one at most, of any height.
  const FootprintPlace* heights = nullptr;
  std::int32_t low[3] = {0, 0, 0}, high[3] = {0, 0, 0};  ///< [leaves] box of all columns, inclusive

#if defined(__CUDACC__)
  [[nodiscard]] __device__ FootprintPlace at(std::int32_t dx, std::int32_t dy) const { return in(places, dx, dy); }
  [[nodiscard]] __device__ FootprintPlace heightAt(std::int32_t dx, std::int32_t dy) const {
    return in(heights, dx, dy);
  }

 private:
  [[nodiscard]] __device__ FootprintPlace in(const FootprintPlace* table, std::int32_t dx, std::int32_t dy) const {
    if (dx < low[0] || dx > high[0] || dy < low[1] || dy > high[1]) return {};
    return table[static_cast<std::int64_t>(dx - low[0]) * (high[1] - low[1] + 1) + (dy - low[1])];
  }
#endif
};

// KnownTables: what is remembered about directions.

/// From cells back to directions of the tool (ExactTables::cell_directions).
struct CellTableView {
  const DirectionArc* table = nullptr;  ///< null: there is none
  const DirectionMask* sets = nullptr;  ///< in place of it, for directions of any kind
  std::int32_t low[3] = {0, 0, 0}, size[3] = {0, 0, 0};
};
struct KnownView {
  std::uint64_t* levels = nullptr;  ///< [slots.slots n] by id
  std::uint32_t* notes = nullptr;   ///< [n] what the slots hold; null: each word has its own
  FreedWord* freed = nullptr;       ///< [slots.words groups]
  bool follows = false;             ///< bounds follow flips: there are counts and what was lost, no levels
  std::uint16_t* counts = nullptr;  ///< [8 slots.slots n] by id: known_count
  /// [8 slots.words groups] voxels that stopped colliding in this update, as an upper bound; only where a group's masks
  /// say that any may have.
  std::uint16_t* lost = nullptr;
  std::uint32_t* counted_bits = nullptr;  ///< [n / 32] points with any bound that is known
  /// [n / 32] where bounds follow flips, points at which collisions may have become fewer in this update, or more in
  /// the best direction. At the others flips change nothing but corridors.
  std::uint32_t* stirred_bits = nullptr;
  KnownSlots slots;  ///< words of eight directions
  int count_to = 0;  ///< collisions are counted up to here, to remember them
  KnownLevels scale;

  /// Whether anything is remembered.
  [[nodiscard]] ACCESSVDB_HOSTDEV bool remembers() const { return levels != nullptr || counts != nullptr; }
};

// DueLists: what has to be evaluated.

/// A point to evaluate.
struct ListedDue {
  std::uint32_t id;
  std::uint32_t next;  ///< next in the same block, or kNoIndex
  Due due;             ///< Some or All
};
/// Points to evaluate, by blocks.
struct DueView {
  ListedDue* items = nullptr;
  std::uint32_t* head = nullptr;    ///< [blocks] kNoIndex if none of its points is due
  std::uint32_t* busy = nullptr;    ///< blocks with a head
  std::uint32_t* order = nullptr;   ///< items with some directions in question, block by block
  std::uint32_t* whole = nullptr;   ///< items that need all directions
  std::uint32_t* place = nullptr;   ///< [blocks] number of a block's first point, or kNoIndex (launchPlaceFlipped)
  std::uint8_t* waiting = nullptr;  ///< [n] WaitingFlag; null: what is due is evaluated at once
  SearchCounters* counters = nullptr;
};

/// Flags of a point, if points wait for their turn (WorkQueue).
enum WaitingFlag : std::uint8_t {
  kWaiting = 1,         ///< in the queue
  kAsked = 2,           ///< to be put into the queue
  kAskedByItself = 4,   ///< the point itself changed, not only the map around it (ScoreItem::evidence)
  kConfidentPoint = 8,  ///< enough observations; in the paper's policy others never wait
};

/// How points are evaluated in this update.
struct EvaluationView {
  ApproachView approach;
  UpdateRule rule;
  KnownView known;
};

}  // namespace accessvdb::kernels
