// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tools of a field beside its first one. They read the same map and the same mirror; each has its own tables, its
/// own state of the points and its own evaluations, so that its results are those of a field with it alone. Tools that
/// are tried in the same directions share the points' views, their normals, and what scans changed.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/table_progress.h"
#include "accessvdb/tool_spec.h"
#include "change/gone_points.h"
#include "field/scored_points.h"
#include "field/scoring_setup.h"
#include "field/state_head.h"
#include "field/window_reach.h"
#include "tsdf/packed_map.h"
#include "update/scan_changes.h"
#include "update/scheduler.h"

namespace accessvdb::internal {

/// @throws InvalidArgument "tool.policy"  for what only knows one tool
/// @throws ResourceLimit "orientations.count"  for more directions of all tools than an index can name
void requireManyTools(const std::vector<ToolSpec>& tools, const FieldParams& resolved);

/// The parameters of a field with this tool alone, with every rule applied, its rolls included.
[[nodiscard]] FieldParams resolvedFor(const ToolSpec& tool, const FieldParams& params);

class FurtherTools {
 public:
  /// What they have in common with the first tool. All of it must outlive them.
  struct Shared {
    PackedMap& map;
    PointStore& points;  ///< of the first tool
    kernels::Backend& backend;
    std::optional<VoxelColumnBox> core;  ///< as for makeMapReads()
    const GonePoints* gone = nullptr;    ///< only for ChangeMode::Full
  };
  /// One of them.
  struct Tool {
    Tool(const ToolSpec& spec, const FieldParams& resolved, kernels::Backend& backend, const TableProgress& progress)
        : params(resolved), setup(spec.tool, params, backend, progress) {}

    FieldParams params;  ///< resolved, as if it were alone
    ScoringSetup setup;
    std::size_t views_of = 0;                ///< the tool whose store it reads, counted from the field's first
    std::unique_ptr<PointStore> own_points;  ///< null: it reads another's
    const PointStore* points = nullptr;
    MapReads reads;
    std::unique_ptr<PointScorer> scorer;
  };

  /// @param tools  all of the field's, the first one included
  FurtherTools(const std::vector<ToolSpec>& tools, const FieldParams& resolved, const Shared& shared,
               const TableProgress& progress = {});

  [[nodiscard]] bool empty() const { return tools_.empty(); }
  [[nodiscard]] std::size_t size() const { return tools_.size(); }
  [[nodiscard]] const Tool& operator[](std::size_t n) const { return *tools_[n]; }

  /// One scheduler for all tools of the field; call it again after forget(). @param scorer, setup  of the first tool
  [[nodiscard]] std::unique_ptr<UpdateScheduler> makeSchedulers(PointScorer& scorer, const ScoringSetup& setup);
  /// Forgets the state of all points, for a scheduler that is made anew.
  void forget();

  /// Stores whose points have other seen directions than the first tool's, in the order of their tools.
  [[nodiscard]] std::vector<PointStore*> ownStores() const;

  /// The points of each tool, of the first one first.
  [[nodiscard]] std::vector<ScoredField> ofEach(const ScoredField& first) const;

  /// What a saved state says of the field's tools; nothing of one alone. @param tools  all of the field's
  [[nodiscard]] std::vector<SavedTool> saved(const std::vector<ToolSpec>& tools) const;

  [[nodiscard]] std::uint64_t hostBytes() const;
  [[nodiscard]] std::uint64_t deviceBytes() const;

 private:
  void makeScorer(Tool& tool) const;

  Shared shared_;
  std::vector<std::unique_ptr<Tool>> tools_;
};

}  // namespace accessvdb::internal
