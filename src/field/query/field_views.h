// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The views that a field returns: batch queries on the host, views for kernels. Knows when they expire.
#pragma once

#include <tbb/task_arena.h>

#include <atomic>
#include <memory>
#include <optional>

#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "field/query/merged_tools.h"
#include "field/query/query_index.h"
#include "field/query/query_source.h"
#include "field/query/withheld.h"
#include "launch/device_array.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// The parts of a field that views show.
struct ViewInputs {
  const PackedMap& map;
  kernels::Backend& backend;
  kernels::OccupancyView mirror;
  kernels::DistanceView distances;  ///< no grid if there is no mirror of them
  kernels::ApproachView approach;   ///< in the backend's memory
  Eigen::Vector3d origin_W;
  std::vector<ViewedTool> tools;
  std::span<const std::uint8_t> withheld_for_all = {};  ///< Withheld::for_all

  /// Its scorer has what does not depend on the tool.
  [[nodiscard]] const PointScorer& scorer() const { return tools.front().scorer; }
  /// What a state of the one tool, or of all tools merged, still says. MergedTools has seen to what waits.
  [[nodiscard]] Withheld withheld() const {
    return {withheld_for_all, tools.size() == 1 ? scorer().waiting() : std::span<const std::uint8_t>()};
  }
};

/// One per field; one thread at a time.
class FieldViews {
 public:
  FieldViews();
  ~FieldViews();
  FieldViews(const FieldViews&) = delete;
  FieldViews& operator=(const FieldViews&) = delete;

  /// Call before the field changes: all existing views become out of date.
  void expire() { revision_->fetch_add(1, std::memory_order_acq_rel); }
  [[nodiscard]] std::uint64_t revision() const { return revision_->load(std::memory_order_acquire); }
  [[nodiscard]] std::shared_ptr<const std::atomic<std::uint64_t>> revisionCounter() const { return revision_; }

  [[nodiscard]] BatchQuery query(const ViewInputs& parts, tbb::task_arena& arena);
  /// @throws DeviceError if the field's backend is not of this kind
  [[nodiscard]] DeviceView view(const ViewInputs& parts, bool on_gpu);

  [[nodiscard]] std::uint64_t bytes() const { return index_.bytes(); }

 private:
  /// Of several tools, for the field's present revision.
  const MergedTools& merged(const ViewInputs& parts);
  /// Of the tool, or merged, in the backend's memory.
  kernels::PointStateView stateOf(const ViewInputs& parts);

  std::shared_ptr<std::atomic<std::uint64_t>> revision_;
  QueryIndex index_;
  std::shared_ptr<const BatchQuery::Impl> query_;  ///< the last one
  std::unique_ptr<const MergedTools> merged_;
  std::uint64_t merged_revision_ = 0;
  void withhold(const ViewInputs& parts, const kernels::PointStateView& state, DeviceView& view);
  void sendTold(kernels::Backend& backend, const HostPointState& told);

  std::optional<HostPointState> told_;  ///< of the last view in which points are withheld
  std::uint64_t told_revision_ = 0;
  // The same where the view is on a GPU.
  kernels::DeviceArray<PointLabel> device_labels_;
  kernels::DeviceArray<PointReason> device_reasons_;
  kernels::DeviceArray<std::uint16_t> device_scores_, device_directions_;
};

}  // namespace accessvdb::internal
