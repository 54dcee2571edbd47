// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Internals of a BatchQuery, for the field that makes it.
#pragma once

#include <tbb/task_arena.h>

#include "field/query/query_source.h"

namespace accessvdb {

struct ACCESSVDB_PRIVATE BatchQuery::Impl {
  /// The field's revision once it has been destroyed.
  static constexpr std::uint64_t kGone = ~std::uint64_t{0};

  internal::QuerySource source;
  tbb::task_arena* arena = nullptr;  ///< the field's
  std::shared_ptr<const std::atomic<std::uint64_t>> field_revision;
  std::uint64_t revision = 0;

  [[nodiscard]] bool current() const { return field_revision->load(std::memory_order_acquire) == revision; }
};

}  // namespace accessvdb
