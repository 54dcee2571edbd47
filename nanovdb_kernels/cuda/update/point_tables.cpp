// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/point_tables.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "cuda/memory/growing.h"
#include "cuda/update/update_kernels.h"
#include "hostdev/voxel_scale.h"

namespace accessvdb::kernels {

PointTables::PointTables(const std::shared_ptr<DeviceContext>& context, DeviceMemory& memory,
                         const NeighbourTables& tables, bool keeps)
    : memory_(memory),
      words_(static_cast<std::size_t>((tables.num_directions + 63) / 64)),
      multiprocessors_(context->multiprocessors()),
      by_cell_(tables.neighbours <= kMostNeighboursByCell),
      keeps_(keeps && by_cell_),
      block_(context),
      mean_(context),
      to_sensor_(context),
      reach_(context),
      own_seen_(context),
      kept_(context) {
  view_.groups.log2 = tables.group_log2;
  view_.rule.voxel_size_m = static_cast<float>(tables.voxel_size_m);
  view_.rule.inverse_voxel_size = VoxelScale(tables.voxel_size_m).inverse;
  view_.rule.steps_per_m = neighbourStepsPerMetre(tables.radius_m);
  view_.rule.radius_squared = neighbourRadiusSquared(tables.radius_m);
  view_.rule.neighbours = tables.neighbours;
  view_.rule.view_neighbours = tables.view_neighbours;
  if (tables.choice.isMade()) competition_.emplace(context, memory_, tables);
}

void PointTables::grow(const AdmitInput& input, cudaStream_t stream) {
  growPoints(input.num_points, stream);
  growBlocks(input, stream);
  if (competition_) competition_->grow(input.num_points, input.num_blocks, stream);
  growFilled(with_points_, memory_, input.num_groups, 0, stream);
  growFilled(group_leaf_, memory_, std::size_t{3} * input.num_groups, 0, stream);
  view_.groups.of_block = group_of_.data();
  view_.groups.with_points = with_points_.data();
  view_.groups.leaf = group_leaf_.data();
  view_.groups.groups = input.num_groups;
  view_.points = input.states.front();
  view_.num_points = input.num_points;
  view_.state = {block_.data(),    mean_.data(),  to_sensor_.data(),
                 own_seen_.data(), reach_.data(), keeps_ ? kept_.data() : nullptr};
}

void PointTables::growPoints(std::uint32_t points, cudaStream_t stream) {
  block_.grow(points);
  mean_.grow(std::size_t{3} * points);
  to_sensor_.grow(std::size_t{3} * points);
  own_seen_.grow(points * words_);
  reach_.grow(points);
  static_assert(KeptNeighbours::kNone == -1);
  if (keeps_) kept_.growFilled(points, 0xff, stream);
}

void PointTables::growBlocks(const AdmitInput& input, cudaStream_t stream) {
  const std::uint32_t blocks = input.num_blocks, kept = view_.index.blocks;
  const auto grow = [&](auto& array, std::size_t each) {
    array.growWithRoom(memory_, blocks * each, roomFor(blocks) * each, kept * each);
  };
  grow(leaf_, 3);
  grow(first_, 1);
  grow(count_, 1);
  grow(block_reach_, 1);
  grow(group_of_, 1);
  growFilled(ids_, memory_, input.num_slots, 0, stream);
  if (hash_keys_.size() < 2 * std::size_t{blocks}) {
    const std::size_t capacity = std::bit_ceil(std::size_t{3} * blocks + 1024);
    // Both or none, if memory is short.
    hash_keys_ = DeviceArray<std::uint64_t>();
    hash_blocks_ = DeviceArray<std::uint32_t>();
    DeviceArray<std::uint64_t> keys(memory_, capacity);
    hash_blocks_ = DeviceArray<std::uint32_t>(memory_, capacity);
    hash_keys_ = std::move(keys);
    fillBytes(hash_keys_.data(), 0xff, hash_keys_.bytes(), stream);
    refreshIndex(kept);
    launchRehash(view_.index, stream);
  }
  refreshIndex(blocks);
}

void PointTables::refreshIndex(std::uint32_t blocks) {
  BlockIndexView& index = view_.index;
  index.hash = {hash_keys_.data(), static_cast<std::uint32_t>(hash_keys_.size() - 1)};
  index.block_at = hash_blocks_.data();
  index.leaf = leaf_.data();
  index.first = first_.data();
  index.count = count_.data();
  index.ids = ids_.data();
  index.reach_m = block_reach_.data();
  index.blocks = blocks;
}

DeviceList<PointDelta> PointTables::admit(const AdmitInput& input, const MovedView& moved, const KnownView& known,
                                          std::uint32_t first_place, cudaStream_t stream) {
  const DeviceList<BlockDelta> blocks = block_deltas_.send(input.blocks, memory_, stream);
  const DeviceList<std::uint32_t> ids = block_ids_.send(input.block_ids, memory_, stream);
  launchAdmitBlocks(view_, blocks, ids.data, stream);
  const DeviceList<PointDelta> deltas = deltas_.send(input.deltas, memory_, stream);
  launchAdmitPoints(view_, moved, known, deltas, first_place, stream);
  if (competition_) competition_->admit(deltas, input.returns, first_place != kNoIndex, stream);
  return deltas;
}

void PointTables::setWeights(std::span<const PointWeight> weights, cudaStream_t stream) {
  launchSetWeights(view_.points, weights_.send(weights, memory_, stream), stream);
}

namespace {

template <typename T>
void growForChunks(DeviceArray<T>& array, DeviceMemory& memory, std::uint32_t points) {
  const std::size_t part = std::min(points, PointTables::kChunk);
  if (array.size() < part) array.grow(memory, std::min<std::size_t>(roomFor(part), PointTables::kChunk), 0);
}

}  // namespace

void PointTables::growLeft(std::uint32_t points) {
  if (by_cell_) {
    left_.growWithRoom(memory_, points, roomFor(points), 0);
  } else {
    growForChunks(found_, memory_, points);
  }
}
void PointTables::growChunks(std::uint32_t points) {
  growForChunks(found_, memory_, points);
  growForChunks(part_, memory_, points);
  growForChunks(left_, memory_, points);
}

void PointTables::makeByCell(const MovedView& moved, std::uint32_t begin, std::uint32_t end, FoundNeighbourhood* to,
                             cudaStream_t stream) {
  if (!by_cell_) {
    for (std::uint32_t first = begin; first < end; first += kChunk) {
      const PointChunk part = {moved.ids, &moved.counters->moved, first, std::min(end - first, kChunk)};
      makeNeighbourhoods(part, &moved.counters->failed, to + (first - begin), stream);
    }
    return;
  }
  const MovedRange range = {begin, end, to, left_.data()};
  launchTakeOverKept(view_, moved, range, multiprocessors_, stream);
  launchNeighboursByCell(view_, moved, range, multiprocessors_, stream);
  launchNearestOfLeft(view_, moved, range, multiprocessors_, stream);
  chooseOnSurface({moved.ids, &moved.counters->moved, begin, end - begin}, to, stream);
}

void PointTables::forgetKept(const MovedView& moved, cudaStream_t stream) const {
  launchForgetKept(view_, moved, stream);
}

FoundNeighbourhood* PointTables::makeByCell(const MovedView& moved, const PointChunk& part, cudaStream_t stream) {
  makeByCell(moved, part.first, part.first + part.count, part_.data(), stream);
  return part_.data();
}

FoundNeighbourhood* PointTables::makeNeighbourhoods(const PointChunk& part, std::uint32_t* failed,
                                                    cudaStream_t stream) {
  makeNeighbourhoods(part, failed, part_.data(), stream);
  return part_.data();
}

void PointTables::makeNeighbourhoods(const PointChunk& part, std::uint32_t* failed, FoundNeighbourhood* to,
                                     cudaStream_t stream) {
  launchNearest(view_, part, failed, found_.data(), stream);
  launchMakeNeighbourhoods(view_, part, found_.data(), to, stream);
  chooseOnSurface(part, to, stream);
}

/// Leaves normals to the points that are scored. @param found  [part.count]
void PointTables::chooseOnSurface(const PointChunk& part, FoundNeighbourhood* found, cudaStream_t stream) const {
  if (competition_) launchChooseOnSurface(view_, competition_->view(), part, found, stream);
}

}  // namespace accessvdb::kernels
