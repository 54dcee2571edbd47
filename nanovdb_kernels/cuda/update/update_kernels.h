// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Launches of the kernels of an update, in the order in which they run. All pointers are device memory; all calls only
/// queue work.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "cuda/search/busy_map.h"
#include "cuda/search/score_kernels.h"
#include "cuda/update/update_views.cuh"

namespace accessvdb::kernels {

// point_index.cu: takes points in.

/// Lists of ids of blocks, and new blocks into the hash.
void launchAdmitBlocks(const UpdateView& view, const BlockNews* blocks, const std::uint32_t* block_ids,
                       std::uint32_t count, cudaStream_t stream);
/// All blocks into an empty hash.
void launchRehash(const BlockIndexView& index, cudaStream_t stream);
/// State of new and touched points. @param first_place  of view.places, or kNoIndex: nothing has a neighbourhood yet
void launchAdmitPoints(const UpdateView& view, const PointNews* news, std::uint32_t count, std::uint32_t first_place,
                       cudaStream_t stream);
void launchSetWeights(const UpdateView& view, const PointWeight* weights, std::uint32_t count, cudaStream_t stream);

// moved_points.cu: whose neighbourhoods may have changed.

/// Points near places -> view.moved. @param most_touched  upper bound of counters.touched_blocks
void launchFindMoved(const UpdateView& view, std::uint32_t most_touched, cudaStream_t stream);
void launchAddCrossed(const UpdateView& view, const PointWeight* points, std::uint32_t count, cudaStream_t stream);

// nearest_points.cu

/// Of view.moved[first .. first + count), as far as there are so many. @param found  [count] out
void launchNearest(const UpdateView& view, std::uint32_t first, std::uint32_t count, FoundNeighbours* found,
                   cudaStream_t stream);
/// @param found  of the same part  @param neighbourhoods  [count] out
void launchMakeNeighbourhoods(const UpdateView& view, std::uint32_t first, std::uint32_t count,
                              const FoundNeighbours* found, Neighbourhood* neighbourhoods, cudaStream_t stream);
/// How many of the moved points have their neighbourhoods: `most`, or as many as there are -> counters.prepared.
void launchNotePrepared(const UpdateView& view, std::uint32_t most, cudaStream_t stream);

// flip_masks.cu: what flips mean for groups of blocks.

/// The tiles of the flips of view.flips.list -> the hash, counters.flip_tiles.
void launchFindTiles(const UpdateView& view, std::uint32_t count, cudaStream_t stream);
/// The flips into their tiles.
void launchAddFlips(const UpdateView& view, std::uint32_t count, cudaStream_t stream);
/// Masks of all groups; ages what is known of the directions of their points.
void launchGroupMasks(const UpdateView& view, cudaStream_t stream);

// due_points.cu: what has to be evaluated.

/// Normals, seen directions and what is due of view.moved[first .. first + count). @param neighbourhoods  [count]
void launchTakeNeighbours(const UpdateView& view, std::uint32_t first, std::uint32_t count,
                          const Neighbourhood* neighbourhoods, cudaStream_t stream);
/// What is due of points [first, first + count) because of flips alone.
void launchDueByFlips(const UpdateView& view, std::uint32_t first, std::uint32_t count, cudaStream_t stream);

/// What is due of points whose turn it is: as much as may have changed since they were last evaluated. They do not wait
/// any more.
void launchDueOfWaiting(const UpdateView& view, const std::uint32_t* ids, std::uint32_t count, cudaStream_t stream);

// due_search.cu: evaluates.

/// What the search needs beside the view.
struct DueSearch {
  OccupancyView map;
  ToolKernelView tool;
  ToolSlabsView slabs;
  BusyMapView busy;
  WindowPlan window;  ///< of a warp
  int multiprocessors = 1;
};
/// Where it runs: on `main`, and in part on `beside`, on which nothing else waits to run. The events are its own.
struct DueStreams {
  cudaStream_t main, beside;
  cudaEvent_t fork, join;
};
/// view.due; it is empty afterwards.
/// @param most_busy  upper bound of counters.busy
void launchDueSearch(const UpdateView& view, const DueSearch& search, std::uint32_t most_busy,
                     const DueStreams& streams);

}  // namespace accessvdb::kernels
