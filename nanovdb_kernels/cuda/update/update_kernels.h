// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Launches an update's kernels, in the order in which they run. All pointers are device memory; calls only queue work.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "cuda/search/busy_map.h"
#include "cuda/search/score_kernels.h"
#include "cuda/update/update_views.cuh"

namespace accessvdb::kernels {

// point_index.cu: admits points.

/// Stores the id lists of blocks, and inserts new blocks into the hash.
void launchAdmitBlocks(const PointsView& points, DeviceList<BlockDelta> blocks, const std::uint32_t* block_ids,
                       cudaStream_t stream);
/// Inserts all blocks into an empty hash.
void launchRehash(const BlockIndexView& index, cudaStream_t stream);
/// Stores the state of new and touched points. Nothing is known about directions of new ones.
/// @param first_place  index into moved.places, or kNoIndex: nothing has a neighbourhood yet
void launchAdmitPoints(const PointsView& points, const MovedView& moved, const KnownView& known,
                       DeviceList<PointDelta> deltas, std::uint32_t first_place, cudaStream_t stream);
/// Makes the state of new points for a further tool. @param known  of this tool
void launchAdmitStates(const PointStateView& state, const KnownView& known, DeviceList<PointDelta> deltas,
                       cudaStream_t stream);
void launchSetWeights(const PointStateView& points, DeviceList<PointWeight> weights, cudaStream_t stream);

// moved_points.cu: finds points whose neighbourhoods may have changed.

/// Adds points near places to moved.ids, and those that compete with a touched one.
/// @param max_touched  upper bound of counters.touched_blocks
void launchFindMoved(const PointsView& points, const MovedView& moved, const CompetitionView& competition,
                     std::uint32_t max_touched, cudaStream_t stream);
/// Adds points that became confident to moved.ids.
void launchAddCrossed(const PointStateView& points, const MovedView& moved, DeviceList<PointWeight> crossed,
                      cudaStream_t stream);

// kept_neighbours.cu, cell_neighbours.cu and nearest_points.cu: make their neighbourhoods.

/// Makes those of moved points that launchFindMoved has found whose neighbours are the same points; the others are
/// marked. @param range  of the list; indices beyond its end are skipped
void launchTakeOverKept(const PointsView& points, const MovedView& moved, const MovedRange& range, int multiprocessors,
                        cudaStream_t stream);
/// Forgets what is kept of all moved points, as their neighbourhoods will not be stored.
void launchForgetKept(const PointsView& points, const MovedView& moved, cudaStream_t stream);

/// @param failed  set to 1 if some neighbours were not found  @param found  [part.count] out
void launchNearest(const PointsView& points, const PointChunk& part, std::uint32_t* failed, FoundNeighbours* found,
                   cudaStream_t stream);
/// @param found  from launchNearest for the same part  @param neighbourhoods  [part.count] out
void launchMakeNeighbourhoods(const PointsView& points, const PointChunk& part, const FoundNeighbours* found,
                              FoundNeighbourhood* neighbourhoods, cudaStream_t stream);
/// With more neighbours than this, most points would be left over by launchNeighboursByCell: it looks at a tenth more
/// than that, or a sixth, and has room for 256.
inline constexpr int kMostNeighboursByCell = 220;
/// Makes the neighbourhoods of the moved points that launchTakeOverKept has left. What it cannot make is left over.
/// @param range  of the list; indices beyond its end are skipped
void launchNeighboursByCell(const PointsView& points, const MovedView& moved, const MovedRange& range,
                            int multiprocessors, cudaStream_t stream);
/// Makes the neighbourhoods of the points that were left over. Sets counters.failed if some neighbours were not found.
void launchNearestOfLeft(const PointsView& points, const MovedView& moved, const MovedRange& range, int multiprocessors,
                         cudaStream_t stream);
/// Sets counters.prepared, the number of moved points with neighbourhoods: `most`, or all if there are fewer.
void launchNotePrepared(MovedCounters* counters, std::uint32_t most, cudaStream_t stream);

// competition.cu: which points are scored, if not all are.

/// Stores what points compete with. @param touches  whether to note the touched voxels
void launchAdmitReturns(const CompetitionView& competition, DeviceList<PointDelta> deltas, const std::uint32_t* returns,
                        bool touches, cudaStream_t stream);
/// Takes the normals of points that are beside the surface. @param neighbourhoods  [part.count] of the points
void launchChooseOnSurface(const PointsView& points, const CompetitionView& competition, const PointChunk& part,
                           FoundNeighbourhood* neighbourhoods, cudaStream_t stream);

// flip_masks.cu: what flips mean for groups of blocks.

/// Inputs of these kernels, of one tool.
struct FlipContext {
  BlockIndexView index;
  GroupsView groups;
  FootprintView footprint;
  CellTableView covering;
  KnownView known;  ///< aged by the flips
  int num_directions = 0;
  CorridorView corridors;  ///< table null: blocked corridors are forgotten by leaf
  PointStateView points;
  float inverse_voxel_size = 0;
};
/// Inserts the tiles of flips.list into the hash; counts them in *num_tiles.
void launchFindTiles(const FlipsView& flips, std::uint32_t count, std::uint32_t* num_tiles, cudaStream_t stream);
/// Adds the flips to their tiles.
void launchAddFlips(const FlipsView& flips, std::uint32_t count, cudaStream_t stream);
/// Computes the masks of all groups, and ages what is known about the directions of their points.
void launchGroupMasks(const FlipContext& context, const FlipsView& flips, const GroupMasksView& masks,
                      cudaStream_t stream);

// sort_voxels.cu: sorts flipped voxels by place.

/// Fills flips.by_layer and layer_begin.
void launchSortVoxels(const FlipsView& flips, std::uint32_t count, std::uint32_t tiles, cudaStream_t stream);

// follow_flips.cu: lets bounds of collisions follow flips.

/// Inputs and outputs, of one tool.
struct FollowContext {
  PointsView points;
  KnownView known;  ///< its counts follow
  ArcsView arcs;
  FlipsView flips;
  GroupMasksView masks;
  float inverse_voxel_size = 0;
};
/// Once per update: a flip must not count twice.
void launchFollowFlips(const FollowContext& context, cudaStream_t stream);

// due_points.cu: decides what has to be evaluated.

/// Inputs and outputs of these kernels, of one tool.
struct DueContext {
  PointsView points;
  EvaluationView evaluation;
  GroupMasksView masks;
  DueView due;
};
/// Stores normals and seen directions of some moved points. @param neighbourhoods  [part.count] in: those; out: what
/// they were before, of the points that changed  @param changed_bits  out: which these are
/// @param chooses  whether points may be beside the surface
void launchStoreNeighbours(const PointsView& points, const PointChunk& part, FoundNeighbourhood* neighbourhoods,
                           std::uint32_t* changed_bits, bool chooses, cudaStream_t stream);
/// Decides what is due at those that changed. @param before  [part.count] from launchStoreNeighbours, like the bits
void launchDueAfterMoves(const DueContext& context, const PointChunk& part, const FoundNeighbourhood* before,
                         const std::uint32_t* changed_bits, cudaStream_t stream);
/// Numbers the points at which flips may matter, those of a block one after the other: counters.near_flips in all.
/// @param changed_bits  points to skip: what is due there has been decided
void launchPlaceFlipped(const DueContext& context, const std::uint32_t* changed_bits, cudaStream_t stream);
/// Decides what is due at those of blocks whose first one has one of the numbers [first, first + count).
void launchDueByFlips(const DueContext& context, std::uint32_t first, std::uint32_t count,
                      const std::uint32_t* changed_bits, cudaStream_t stream);
/// Decides what is due at points whose turn it is: whatever may have changed since their last evaluation. Ends their
/// wait.
void launchDueAfterWaiting(const DueContext& context, DeviceList<std::uint32_t> ids, cudaStream_t stream);

// due_search.cu: evaluates points.

/// What the search reads of the map and the tool.
struct DueSearch {
  OccupancyView map;
  ToolKernelView tool;
  ToolSlabsView slabs;
  BusyMapView busy;
  WindowPlan window;  ///< of each warp
  int multiprocessors = 1;
};
/// Where it runs: on `main`, and in part on `beside`, where nothing else is queued. The events are the search's own.
struct DueStreams {
  cudaStream_t main, beside;
  cudaEvent_t fork, join;
};
/// What the search evaluates, and by what rules. Its due list is empty afterwards.
struct DueWork {
  PointsView points;
  EvaluationView evaluation;
  DueView due;
  OutcomeCounters* outcome = nullptr;
};
/// @param max_busy  upper bound of counters.busy
void launchDueSearch(const DueWork& work, const DueSearch& search, std::uint32_t max_busy, const DueStreams& streams);

}  // namespace accessvdb::kernels
