// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/field_views.h"

#include <algorithm>
#include <utility>

#include "accessvdb/error.h"
#include "field/query/batch_query_impl.h"
#include "hostdev/voxel_scale.h"

namespace accessvdb::internal {
namespace {

bool onHost(const kernels::Backend& backend) { return backend.hasHostMemory(); }

}  // namespace

FieldViews::FieldViews() : revision_(std::make_shared<std::atomic<std::uint64_t>>(0)) {}
FieldViews::~FieldViews() { revision_->store(BatchQuery::Impl::kGone, std::memory_order_release); }

const MergedTools& FieldViews::merged(const ViewInputs& parts) {
  if (!merged_ || merged_revision_ != revision()) {
    merged_.reset();  // avoids two of them at once
    merged_ = std::make_unique<const MergedTools>(parts.backend, parts.tools);
    merged_revision_ = revision();
  }
  return *merged_;
}

kernels::PointStateView FieldViews::stateOf(const ViewInputs& parts) {
  return parts.tools.size() == 1 ? parts.scorer().device().view() : merged(parts).view();
}

BatchQuery FieldViews::query(const ViewInputs& parts, tbb::task_arena& arena) {
  if (query_ && query_->current()) return BatchQuery(query_);
  query_.reset();  // avoids two copies of the state at once
  const PointStore& points = parts.scorer().points();
  const double voxel_size_m = parts.map.params().voxel_size_m;
  arena.execute([&] { index_.extend(points); });
  auto impl = std::make_shared<BatchQuery::Impl>();
  impl->source.map = &parts.map;
  impl->source.index = &index_;
  const kernels::PointStateView state = arena.execute([&] { return stateOf(parts); });
  impl->source.state = std::make_shared<const HostPointState>(parts.backend, state, parts.scorer().device().size(),
                                                              onHost(parts.backend), parts.withheld());
  for (const ViewedTool& tool : parts.tools) {
    const auto more = directionVectors(tool.scorer.params().approach);
    impl->source.directions.insert(impl->source.directions.end(), more.begin(), more.end());
  }
  impl->source.origin_W = parts.origin_W;
  impl->source.voxel_size_m = static_cast<float>(voxel_size_m);
  impl->source.inverse_voxel_size = kernels::VoxelScale(voxel_size_m).inverse_float32;
  impl->arena = &arena;
  impl->field_revision = revision_;
  impl->revision = revision();
  query_ = std::move(impl);
  return BatchQuery(query_);
}

/// The view gets labels of its own: the backend keeps those that it found, which it compares with later. Views of one
/// revision share them, so that a later one leaves those before it in place.
void FieldViews::withhold(const ViewInputs& parts, const kernels::PointStateView& state, DeviceView& view) {
  const bool on_host = onHost(parts.backend);
  if (!told_ || told_revision_ != revision()) {
    told_.reset();  // also if what follows throws
    HostPointState told(parts.backend, state, view.points.count, on_host, parts.withheld());
    if (!on_host) sendTold(parts.backend, told);
    told_ = std::move(told);
    told_revision_ = revision();
  }
  view.points.label = on_host ? told_->label : device_labels_.data();
  view.points.reason = on_host ? told_->reason : device_reasons_.data();
  view.points.score = on_host ? told_->score : device_scores_.data();
  view.points.direction = on_host ? told_->direction : device_directions_.data();
}

void FieldViews::sendTold(kernels::Backend& backend, const HostPointState& told) {
  const auto send = [&](auto& array, const auto* values) {
    array.grow(backend, told.size, 0);
    array.upload(values, told.size);
  };
  send(device_labels_, told.label);
  send(device_reasons_, told.reason);
  send(device_scores_, told.score);
  send(device_directions_, told.direction);
}

DeviceView FieldViews::view(const ViewInputs& parts, bool on_gpu) {
  if (on_gpu && onHost(parts.backend)) {
    throw DeviceError("device.none", "cpu", "this field is not on a GPU, so it has no device memory to show",
                      "Use BackendKind::Cuda or hostView()");
  }
  if (!on_gpu && !onHost(parts.backend)) {
    throw DeviceError("device.not_host", parts.backend.name(), "the mirror and the points of this field are on the GPU",
                      "Use deviceView() in a kernel, or batchQuery() on the host");
  }
  parts.backend.waitForMirror();
  const kernels::PointStateView state = stateOf(parts);
  DeviceView view;
  view.map = parts.mirror;
  view.distance = parts.distances;
  view.distance_available = parts.distances.grid != nullptr;
  view.points = {state.position_L, state.normal_L,  state.stability,
                 state.score,      state.direction, state.weight,
                 state.label,      state.reason,    parts.scorer().device().size(),
                 state.roll};
  if (parts.withheld().any()) withhold(parts, state, view);
  view.direction_xy = parts.approach.direction_xy;
  view.axes_xyz = parts.approach.axes_xyz;
  view.num_directions = parts.approach.num_directions;
  if (parts.tools.size() > 1) {
    view.direction_xy = nullptr;
    view.axes_xyz = merged(parts).axes_xyz();
    view.num_directions = merged(parts).numDirections();
  }
  view.voxel_size_m = static_cast<float>(parts.map.params().voxel_size_m);
  for (int axis = 0; axis < 3; ++axis) view.origin_W[axis] = parts.origin_W[axis];
  view.revision = revision();
  view.on_gpu = on_gpu;
  return view;
}

}  // namespace accessvdb::internal
