// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/tools/scoring_setup.h"

#include <cmath>
#include <utility>

#include "accessvdb/error.h"
#include "hostdev/voxel_scale.h"

namespace accessvdb::internal {
namespace {

template <typename T>
kernels::DeviceArray<T> uploaded(kernels::DeviceMemory& memory, const std::vector<T>& host) {
  if (host.empty()) return {};  // null: there is nothing
  kernels::DeviceArray<T> array(memory, host.size());
  array.upload(host.data(), host.size());
  return array;
}

}  // namespace

std::vector<double> armDistances(const FieldParams& p) {
  const double tau = p.tsdf.truncation_distance_m;
  std::vector<double> distances;
  for (const double f : p.approach.arm_tau) distances.push_back(f * tau);
  const double length = p.approach.corridor_length_m;
  double last = distances.back();
  while (last + tau < length) distances.push_back(last += tau);
  if (length > last) distances.push_back(length);
  return distances;
}

ScoringSetup::ScoringSetup(const ToolGeometry& tool, const FieldParams& resolved,
                           const ExpandedOrientations& orientations, kernels::Backend& backend,
                           const TableProgress& progress)
    : params_(resolved),
      tool_(ToolKernel::make(tool, resolved, orientations, progress)),
      directions_(orientations.table()),
      memory_(backend) {
  const std::vector<double> distances = armDistances(resolved);
  num_arm_ = static_cast<int>(distances.size());
  for (const ToolOrientation& orientation : orientations.all) addOffsetsAlong(orientation, distances, arm_offsets_);
  d_columns_ = uploaded(memory_, tool_.columns);
  d_column_begin_ = uploaded(memory_, tool_.column_begin);
  d_samples_ = uploaded(memory_, tool_.samples);
  d_sample_begin_ = uploaded(memory_, tool_.sample_begin);
  // The search of a wide set counts by columns.
  const bool by_slabs = backend.usesToolSlabs() && !kernels::isWide(tool_.num_directions);
  if (resolved.update.policy == UpdatePolicy::Exact && by_slabs) loadSlabs();
  d_directions_ = uploaded(memory_, directions_.xy);
  d_axes_ = uploaded(memory_, directions_.axes_xyz);
  d_arm_offsets_ = uploaded(memory_, arm_offsets_);
  const ScoringTables made = tables(nullptr);
  prepared_ = backend.prepareTool(made.tool, made.approach, made.map.inverse_voxel_size);
}

/// Without memory for them the search works without slabs, which only costs time.
void ScoringSetup::loadSlabs() {
  const ToolSlabs slabs = ToolSlabs::make(tool_.view(), tool_.num_directions, ToolSlabs::Limits());
  if (slabs.empty()) return;
  try {
    auto words = uploaded(memory_, slabs.words);
    auto boxes = uploaded(memory_, slabs.boxes);
    auto columns = uploaded(memory_, slabs.columns);
    auto begin = uploaded(memory_, slabs.begin);
    auto rows = uploaded(memory_, slabs.rows);
    d_slab_words_ = std::move(words);
    d_slab_boxes_ = std::move(boxes);
    d_leaf_columns_ = std::move(columns);
    slabs_are_thick_ = slabs.thick;
    d_slab_rows_ = std::move(rows);
    d_leaf_column_begin_ = std::move(begin);
  } catch (const ResourceLimit&) {
    return;
  }
}

kernels::ApproachView ScoringSetup::hostApproach() const {
  kernels::ApproachView view;
  directions_.showIn(view);
  view.arm_offsets = arm_offsets_.data();
  view.num_directions = tool_.num_directions;
  view.num_arm = num_arm_;
  view.normal_cos_min = static_cast<float>(std::cos(params_.approach.normal_cone_rad));
  return view;
}

ScoringTables ScoringSetup::tables(const kernels::OccupancyGrid* grid) const {
  ScoringTables tables;
  tables.map.grid = grid;
  tables.map.inverse_voxel_size = kernels::VoxelScale(params_.tsdf.voxel_size_m).inverse_float32;
  tables.tool = tool_.view();
  tables.tool.columns = d_columns_.data();
  tables.tool.column_begin = d_column_begin_.data();
  tables.tool.samples = d_samples_.data();
  tables.tool.sample_begin = d_sample_begin_.data();
  if (d_leaf_column_begin_.size() > 0) {
    tables.slabs = {d_slab_words_.data(),        d_slab_boxes_.data(), d_leaf_columns_.data(),
                    d_leaf_column_begin_.data(), d_slab_rows_.data(),  slabs_are_thick_};
  }
  tables.approach = hostApproach();
  tables.approach.direction_xy = d_directions_.data();  // null where the host has none
  tables.approach.axes_xyz = d_axes_.data();
  tables.approach.arm_offsets = d_arm_offsets_.data();
  tables.prepared = prepared_.get();
  tables.rule.keep_best = params_.update.policy == UpdatePolicy::Paper;
  tables.rule.stability_min = static_cast<float>(params_.update.stability_min);
  tables.rule.collision_limit = tool_.collision_limit;
  return tables;
}

ScheduledTool ScoringSetup::scheduledFor(PointScorer& scorer) const {
  return {scorer, {hostTool(), hostApproach()}, [this](const auto* mirror) { return tables(mirror); }};
}

std::uint64_t ScoringSetup::hostBytes() const {
  const auto bytesOf = [](const auto& list) { return list.capacity() * sizeof(list[0]); };
  return bytesOf(tool_.columns) + bytesOf(tool_.column_begin) + bytesOf(tool_.samples) + bytesOf(tool_.sample_begin) +
         directions_.bytes() + bytesOf(arm_offsets_) + (prepared_ != nullptr ? prepared_->bytes() : 0);
}

}  // namespace accessvdb::internal
