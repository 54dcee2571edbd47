// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the kernels that take a scan into the device's map share (scan_fuser.cpp). All pointers are device memory.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "cuda/fusion/fuse_leaves.h"
#include "cuda/memory/device_list.h"
#include "hostdev/leaf_keys.h"
#include "hostdev/return_leaves.h"
#include "hostdev/vote_rule.h"
#include "launch/device_array.h"
#include "launch/grid_growth.h"
#include "launch/scan_fuser.h"

namespace accessvdb::kernels {

/// Counts of one scan.
struct FusionCounters {
  std::uint32_t pairs, leaves, heavy;                            ///< that the scan may reach
  std::uint32_t missing_leaves, missing_lowers, missing_uppers;  ///< that it may add
  std::uint32_t missed;                                          ///< leaves whose values are on the host
  std::uint32_t value_needs, vote_needs;                         ///< slots that it may fill
  std::uint32_t new_leaves, new_lowers, new_uppers;
  std::uint32_t freed_values, freed_votes;
  std::uint32_t touched_leaves, changed_leaves, flipped_collisions;
  std::uint64_t distance_updates, cleared_updates, newly_observed, flipped_voxels, flips_hash;
};

/// A scan and the leaves that it may reach, ordered by key.
struct ReachView {
  std::byte* grid;
  ReturnRay* rays;  ///< [ray_count] the last `balls` are positions of the sensor
  std::uint32_t ray_count, balls;
  RegionConstants region;
  NewsRule news;
  bool votes;  ///< whether news may vote
  LeafKeys key_space;
  const std::uint32_t *values, *cleared;  ///< as in FusionView
  std::uint32_t* first_pair;              ///< [ray_count + 1]
  std::uint64_t *keys, *sorted_keys;      ///< [pairs]
  LeafEntry *entries, *sorted_entries;    ///< [pairs]
  std::uint32_t* leaf_of_pair;            ///< [pairs] its number plus one
  std::uint64_t* leaf_keys;               ///< [leaves]
  FusedLeaf* leaves;                      ///< [leaves]
  std::uint32_t* parts;                   ///< [leaves] kHasCone, kHasNews
  std::uint64_t* needs;                   ///< [leaves + 1] slots for values, and for votes in the upper half
  std::uint32_t* missed;                  ///< [leaves] numbers of leaves whose values are on the host
  std::uint8_t *classes, *sorted_classes;
  std::uint32_t *order, *sorted_order;  ///< [leaves]
  FusionCounters* counters;
  static constexpr std::uint32_t kHasCone = 1, kHasNews = 2;
};

/// Slots for values, or for votes.
struct SlotsView {
  std::uint32_t* free;       ///< those given back
  std::uint32_t free_count;  ///< taken from the end, before new ones
  std::uint32_t next;        ///< the first that was never used
};

/// What became of the leaves before one.
struct FoundLeaf {
  std::uint32_t added, freed_values, freed_votes, flipped, flipped_collisions;
};

/// What a scan adds to the grid.
struct GrowthView {
  GridSpace space;              ///< before
  FoundLeaf* found;             ///< [leaves + 1] sums over the leaves before
  std::uint32_t* new_leaves;    ///< [missing_leaves] their numbers
  std::uint32_t* firsts;        ///< [missing_leaves + 1] sums of those that are the first of a new node
  std::uint64_t* new_lowers;    ///< [missing_lowers] key of one of their leaves
  std::uint64_t* new_uppers;    ///< [missing_uppers]
  GridGrowth::Origin* origins;  ///< of new upper nodes, lower nodes and leaves, one kind behind the other
};

/// Values by slot.
struct CacheView {
  static constexpr std::uint32_t kNobody = 0xffffffffu;
  static constexpr std::uint32_t kAges = 4096;  ///< those that are older count as that old
  std::byte* grid;
  std::uint32_t *values, *cleared;  ///< as in FusionView
  std::uint32_t* owner;             ///< the leaf, in units of the grid, or kNobody
  std::uint32_t* stamp;             ///< the latest scan that reached it
  std::uint32_t count;              ///< of slots
};

/// Memory of CUB's algorithms.
struct CubScratch {
  DeviceMemory& memory;
  DeviceArray<std::byte> bytes;
};

// scan_leaves.cu; each queues its work.
/// FusionCounters::pairs becomes 1.
void launchAnswer(FusionCounters* counters, cudaStream_t stream);
/// Counts pairs: ReachView::first_pair, FusionCounters::pairs.
void launchCountPairs(const ReachView& scan, CubScratch& scratch, cudaStream_t stream);
/// Writes and sorts them, and lists the leaves. @param pairs  FusionCounters::pairs  @param key_bits  of keys
void launchListLeaves(const ReachView& scan, std::uint32_t pairs, int key_bits, CubScratch& scratch,
                      cudaStream_t stream);
/// Finds the leaves in the grid.
void launchFindLeaves(const ReachView& scan, std::uint32_t pairs, cudaStream_t stream);
/// Finds out which returns are news, and which slots are needed. May be repeated once more values are here.
void launchFindNeeds(const ReachView& scan, std::uint32_t pairs, CubScratch& scratch, cudaStream_t stream);
/// Gives leaves their slots, and orders them by what they take.
void launchAssignSlots(const ReachView& scan, std::uint32_t leaves, const SlotsView& values, const SlotsView& votes,
                       CubScratch& scratch, cudaStream_t stream);

/// Lists the origins of ReachView::missed.
void launchListMissed(const ReachView& scan, std::uint32_t missed, GridGrowth::Origin* origins, cudaStream_t stream);

// leaf_cache.cu
/// Lets no leaf of the grid have values or votes. @param uppers  upper nodes of the grid
void launchForgetSlots(std::byte* grid, std::uint32_t uppers, cudaStream_t stream);
/// Lets leaves have values, on the host.
void launchNoteOnHost(std::byte* grid, DeviceList<GridGrowth::Origin> leaves, cudaStream_t stream);
/// Puts votes into the slots from `first_slot` on. @param votes  FusionView::votes
void launchTakeVotes(std::byte* grid, DeviceList<VotesRecord> records, std::uint32_t* votes, std::uint32_t first_slot,
                     cudaStream_t stream);
/// Puts what the host sent into slots. @param missed  their numbers among the leaves
void launchTakeRecords(const ReachView& scan, const CacheView& cache, const SlotsView& slots, std::uint32_t first_slot,
                       DeviceList<LeafRecord> records, const std::uint32_t* missed, std::uint32_t scan_number,
                       cudaStream_t stream);
/// Lets leaves that the scan may reach count as reached by it, so that they stay.
void launchKeepReached(const ReachView& scan, const CacheView& cache, std::uint32_t leaves, std::uint32_t scan_number,
                       cudaStream_t stream);
/// How many slots have which age. @param by_age  [kAges] zero
void launchCountAges(const CacheView& cache, std::uint32_t scan_number, std::uint32_t* by_age, cudaStream_t stream);
/// Frees the slots that no scan after `latest` reached. @param freed  zero: how many
void launchEvict(const CacheView& cache, std::uint32_t latest, const SlotsView& slots, std::uint32_t* freed,
                 cudaStream_t stream);
/// @param voxels  [count]  @param weights  [count] largest of what is here, and from bit kPartsShift on, for each part
/// of the window (hostdev/weight_window.h), whether it is on the host; 0 if the voxel itself is not observed
void launchReadWeights(const CacheView& cache, const GridGrowth::Origin* voxels, std::uint32_t count, int reach,
                       std::uint32_t* weights, cudaStream_t stream);
inline constexpr int kPartsShift = 16;
static_assert(kWeightMask >> kPartsShift == 0);

// publish_leaves.cu
/// Appends what flipped to lists. @param first_voxel  voxels of those before
void launchListFlips(const FusionView& fused, const FoundLeaf* found, LeafFlips* leaves, std::uint16_t* voxels,
                     std::uint32_t first_voxel, cudaStream_t stream);
/// Adds the leaves that were reached to the grid, switches bits, and gives back slots that are not needed.
/// @param most  of the counters that say what the scan may add
void launchPublishLeaves(const ReachView& scan, const FusionView& fused, const GrowthView& growth,
                         const FusionCounters& most, const SlotsView& values, const SlotsView& votes,
                         const CacheView& cache, std::uint32_t scan_number, CubScratch& scratch, cudaStream_t stream);

}  // namespace accessvdb::kernels
