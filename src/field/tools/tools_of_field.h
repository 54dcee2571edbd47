// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tools of a field. They read the same map and the same mirror; each has its own tables, its own state of the
/// points and its own evaluations, so that its results are those of a field with it alone. Tools that are tried in the
/// same directions share the points' views, their normals, and what scans changed.
#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/table_progress.h"
#include "accessvdb/tool_spec.h"
#include "change/gone_points.h"
#include "field/state/state_head.h"
#include "field/tools/best_tool.h"
#include "field/tools/scoring_setup.h"
#include "field/tools/shared_tables.h"
#include "field/tools/window_margins.h"
#include "tsdf/packed_map.h"
#include "update/scheduler.h"

namespace accessvdb::internal {

class LeadingMap;

/// @throws InvalidArgument "tool.policy"  for what only knows one tool
/// @throws ResourceLimit "orientations.count"  for more directions of all tools than an index can name
void requireManyTools(const std::vector<ToolSpec>& tools, const FieldParams& resolved);

/// The parameters of a field with this tool alone, with every rule applied, its rolls included.
[[nodiscard]] FieldParams resolvedFor(const ToolSpec& tool, const FieldParams& params);

/// How points are scored for one tool.
struct ToolScoring {
  ToolScoring(const FieldParams& resolved, std::shared_ptr<const ScoringSetup> made)
      : params(resolved), tables(std::move(made)), setup(*tables) {}

  [[nodiscard]] std::uint16_t collisionLimit() const { return setup.tool().collision_limit; }

  FieldParams params;                          ///< resolved, as if the tool were alone
  std::shared_ptr<const ScoringSetup> tables;  ///< its own, or those of several fields
  const ScoringSetup& setup;
  std::size_t views_of = 0;                ///< number of the tool whose store it reads
  std::unique_ptr<PointStore> own_points;  ///< null: it reads another's
  PointStore* points = nullptr;
  MapReads reads;
  std::unique_ptr<PointScorer> scorer;
};

class ToolsOfField {
 public:
  /// What they have in common. All of it must outlive them.
  struct Shared {
    const PackedMap& map;
    kernels::Backend& backend;
    std::optional<VoxelColumnBox> core;                 ///< as for makeMapReads()
    const GonePoints* gone = nullptr;                   ///< only for ChangeMode::Full
    SharedTables* tables = nullptr;                     ///< of several fields; null: these tools make their own
    const std::unique_ptr<LeadingMap>* lead = nullptr;  ///< as for readsOfLead(); null: nothing ever leads
  };

  /// @param specs  named, at least one  @param resolved  for the first of them
  ToolsOfField(std::vector<ToolSpec> specs, const FieldParams& resolved, const Shared& shared,
               const TableProgress& progress = {});

  [[nodiscard]] std::size_t size() const { return tools_.size(); }
  [[nodiscard]] const ToolScoring& front() const { return *tools_.front(); }
  /// @throws InvalidArgument "tool.index"
  [[nodiscard]] const ToolScoring& at(std::size_t k) const;
  [[nodiscard]] auto begin() const { return tools_.begin(); }
  [[nodiscard]] auto end() const { return tools_.end(); }
  [[nodiscard]] const std::vector<ToolSpec>& specs() const { return specs_; }

  /// How far the results of any of them depend on what is around.
  [[nodiscard]] WindowMargins margins() const;
  [[nodiscard]] std::vector<std::uint16_t> collisionLimits() const;
  [[nodiscard]] std::vector<ToolTraits> traits() const { return toolTraits(specs_, collisionLimits(), front().params); }

  /// Forgets the state of all points. The scheduler has to be made again.
  void forget();
  /// One for all of them. The returns of scans are added to the first tool's store by the caller.
  [[nodiscard]] std::unique_ptr<UpdateScheduler> makeScheduler() const;

  /// Stores of points, the first tool's first; the others' have other seen directions.
  [[nodiscard]] std::vector<PointStore*> stores() const;
  /// What a saved state says of the tools; nothing of one alone.
  [[nodiscard]] std::vector<SavedTool> saved() const;

  // Without tables that several fields share. After a device failed during forget(), tools may lack a scorer.
  [[nodiscard]] std::uint64_t hostBytes() const;  ///< with the stores of points
  [[nodiscard]] std::uint64_t deviceBytes() const;

 private:
  Shared shared_;
  std::vector<ToolSpec> specs_;
  std::vector<std::unique_ptr<ToolScoring>> tools_;
};

}  // namespace accessvdb::internal
