// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Launches the kernels of the paper's policy (paper_points.cu). All pointers are device memory; calls only queue work.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "cuda/update/update_views.cuh"
#include "hostdev/direction_search.h"
#include "hostdev/paper_rule.h"

namespace accessvdb::kernels {

/// Points that are evaluated together, at most PointTables::kChunk.
struct PaperTurn {
  std::uint32_t count = 0;
  const std::uint32_t* ids = nullptr;                  ///< [count]
  const FoundNeighbourhood* neighbourhoods = nullptr;  ///< [count]
  const std::uint16_t* hints = nullptr;  ///< [count] best direction of the nearest resolved point; null: none
  ScoreItem* items = nullptr;            ///< [count]
  ScoreResult* results = nullptr;        ///< [count]
  PointLabel* labels_before = nullptr;   ///< [count]
  std::uint8_t* flags = nullptr;         ///< [n] by id, WaitingFlag
};

/// Decides whose direction is a hint for others.
struct HintRule {
  CoarseToFine candidates;
  std::uint16_t collision_limit = 1;  ///< [n_c]
};

/// Lets points enter the queue from now on. @param ids  [count] out: their ids
void launchSetConfident(std::uint8_t* flags, DeviceList<PointWeight> points, std::uint32_t* ids, cudaStream_t stream);
/// Finds the best directions of the nearest resolved points within CoarseToFine::radius_m. @param hints  [count] out:
/// kNoDirection if there is none
void launchFindHints(const PointsView& points, const HintRule& rule, DeviceList<std::uint32_t> ids,
                     std::uint16_t* hints, cudaStream_t stream);
/// Ends the wait of the points, copies their neighbourhoods to their state, and writes what to try to turn.items.
void launchTakeTurn(const PointsView& points, const CoarseToFine& rule, const PaperTurn& turn, cudaStream_t stream);
/// Adds the results to tests, scored, label_changes and resolved.
void launchTallyTurn(const PaperTurn& turn, std::uint16_t collision_limit, UpdateCounters* counters,
                     cudaStream_t stream);

}  // namespace accessvdb::kernels
