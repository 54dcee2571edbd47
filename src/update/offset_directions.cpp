// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/offset_directions.h"

#include <algorithm>
#include <bit>
#include <limits>

namespace accessvdb::internal {

OffsetDirections::OffsetDirections(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes)
    : words_(static_cast<std::size_t>(num_directions + 63) / 64) {
  const std::uint32_t columns = tool.use_samples ? 0 : tool.column_begin[num_directions];
  if (columns == 0) return;
  low_.fill(std::numeric_limits<std::int32_t>::max());
  high_.fill(std::numeric_limits<std::int32_t>::min());
  for (std::uint32_t n = 0; n < columns; ++n) {
    const kernels::VoxelColumn& c = tool.columns[n];
    const Index3 bottom = {c.dx, c.dy, c.dz + std::countr_zero(c.bits)};
    const Index3 top = {c.dx, c.dy, c.dz + 63 - std::countl_zero(c.bits)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low_[axis] = std::min(low_[axis], bottom[axis]);
      high_[axis] = std::max(high_[axis], top[axis]);
    }
  }
  std::uint64_t entries = words_;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    size_[axis] = high_[axis] - low_[axis] + 1;
    entries *= static_cast<std::uint64_t>(size_[axis]);
  }
  if (entries * sizeof(std::uint64_t) > most_bytes) return;
  table_.assign(entries, 0);
  for (int d = 0; d < num_directions; ++d) {
    for (std::uint32_t n = tool.column_begin[d]; n < tool.column_begin[d + 1]; ++n) {
      const kernels::VoxelColumn& c = tool.columns[n];
      for (std::uint64_t bits = c.bits; bits != 0; bits &= bits - 1) {
        const std::uint64_t* entry = at({c.dx, c.dy, c.dz + std::countr_zero(bits)});
        table_[static_cast<std::size_t>(entry - table_.data()) + static_cast<std::size_t>(d >> 6)] |= std::uint64_t{1}
                                                                                                      << (d & 63);
      }
    }
  }
}

}  // namespace accessvdb::internal
