// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Launches of the kernels of the paper's policy (paper_points.cu). All pointers are device memory; all calls only
/// queue work.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "cuda/update/update_views.cuh"
#include "hostdev/direction_search.h"
#include "hostdev/paper_rule.h"

namespace accessvdb::kernels {

/// Points that are evaluated together, at most PointTables::kPart.
struct PaperTurn {
  std::uint32_t count = 0;
  const std::uint32_t* ids = nullptr;             ///< [count]
  const Neighbourhood* neighbourhoods = nullptr;  ///< [count]
  const std::uint16_t* hints = nullptr;           ///< [count] best direction next door; null: not asked for
  ScoreItem* items = nullptr;                     ///< [count]
  ScoreResult* results = nullptr;                 ///< [count]
  PointLabel* labels_before = nullptr;            ///< [count]
  std::uint8_t* flags = nullptr;                  ///< [n] by id, WaitingFlag
};

/// Whose direction is a hint for others.
struct HintRule {
  CoarseToFine candidates;
  std::uint16_t collision_limit = 1;  ///< [n_c]
};

/// Points may enter the queue from now on. @param ids  [count] out: theirs
void launchSetConfident(std::uint8_t* flags, DeviceList<PointWeight> points, std::uint32_t* ids, cudaStream_t stream);
/// Best directions of the nearest resolved points (CoarseToFine::radius_m) -> hints [count], kNoDirection without one.
void launchFindHints(const PointsView& points, const HintRule& rule, DeviceList<std::uint32_t> ids,
                     std::uint16_t* hints, cudaStream_t stream);
/// The points do not wait any more; their neighbourhoods -> their state; what is to be tried -> turn.items.
void launchTakeTurn(const PointsView& points, const CoarseToFine& rule, const PaperTurn& turn, cudaStream_t stream);
/// What came of them -> tests, scored, label_changes, resolved.
void launchTallyTurn(const PaperTurn& turn, std::uint16_t collision_limit, UpdateCounters* counters,
                     cudaStream_t stream);

}  // namespace accessvdb::kernels
