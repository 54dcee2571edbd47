// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/flip_tables.h"

#include <bit>

#include "cuda/memory/growing.h"
#include "launch/lists.h"

namespace accessvdb::kernels {

FlipsView FlipTables::take(const FlipLists& flips, DeviceCounters& counters, cudaStream_t stream) {
  const FlipsOnDevice& on_device = flips.on_device;
  const std::size_t count = on_device.count > 0 ? on_device.count : totalSize(flips.leaves);
  const std::size_t capacity = std::bit_ceil(2 * count + 64);
  keys_.grow(memory_, capacity, 0);
  tiles_.grow(memory_, capacity, 0);
  for (auto* links : {&links_, &arm_links_}) links->growWithRoom(memory_, count, roomFor(count), 0);
  fillBytes(keys_.data(), 0xff, capacity * sizeof(std::uint64_t), stream);
  fillBytes(&counters.data()->flip_tiles, 0, sizeof(std::uint32_t), stream);
  FlipsView by_place;
  by_place.hash = {keys_.data(), static_cast<std::uint32_t>(capacity - 1)};
  by_place.tile_at = tiles_.data();
  by_place.links = links_.data();
  by_place.arm_links = arm_links_.data();
  const bool is_here = on_device.count > 0;
  const DeviceList<LeafFlips> list =
      is_here ? DeviceList<LeafFlips>{on_device.leaves, on_device.count} : list_.send(flips.leaves, memory_, stream);
  const DeviceList<std::uint16_t> voxels = is_here ? DeviceList<std::uint16_t>{on_device.voxels, on_device.voxel_count}
                                                   : voxels_.send(flips.voxels, memory_, stream);
  by_place.voxels = voxels.data;
  by_place.list = list.data;
  launchFindTiles(by_place, list.count, &counters.data()->flip_tiles, stream);
  const std::size_t tiles = counters.read(stream).flip_tiles, columns = tiles * FlipsView::kColumns;
  occupied_.growWithRoom(memory_, tiles, roomFor(tiles), 0);
  kinds_.growWithRoom(memory_, columns, roomFor(columns), 0);
  for (auto* heads : {&heads_, &arm_heads_}) heads->growWithRoom(memory_, columns, roomFor(columns), 0);
  fillBytes(occupied_.data(), 0, tiles * sizeof(std::uint64_t), stream);
  fillBytes(kinds_.data(), 0, columns * sizeof(std::uint64_t), stream);
  for (auto* heads : {&heads_, &arm_heads_}) fillBytes(heads->data(), 0xff, columns * sizeof(std::uint32_t), stream);
  by_place.occupied = occupied_.data();
  by_place.kinds = kinds_.data();
  by_place.head = heads_.data();
  by_place.arm_head = arm_heads_.data();
  launchAddFlips(by_place, list.count, stream);
  if (voxels.count > 0) {
    by_layer_.growWithRoom(memory_, voxels.count, roomFor(voxels.count), 0);
    layer_begin_.growWithRoom(memory_, tiles * FlipsView::kLayers + 1, roomFor(tiles * FlipsView::kLayers + 1), 0);
    by_place.by_layer = by_layer_.data();
    by_place.layer_begin = layer_begin_.data();
    launchSortVoxels(by_place, list.count, static_cast<std::uint32_t>(tiles), stream);
  }
  return by_place;
}

}  // namespace accessvdb::kernels
