// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Related lists, for example one per part of the map.
#pragma once

#include <cstddef>

namespace accessvdb::kernels {

/// Total number of entries.
template <typename Lists>
std::size_t totalSize(const Lists& lists) {
  std::size_t size = 0;
  for (const auto& list : lists) size += list.size();
  return size;
}

}  // namespace accessvdb::kernels
