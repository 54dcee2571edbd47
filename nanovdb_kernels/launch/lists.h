// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lists that belong together: one for each part of the map, say.
#pragma once

#include <cstddef>

namespace accessvdb::kernels {

/// Entries of all of them.
template <typename Lists>
std::size_t totalSize(const Lists& lists) {
  std::size_t size = 0;
  for (const auto& list : lists) size += list.size();
  return size;
}

}  // namespace accessvdb::kernels
