// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a backend evaluates under the exact policy if the host decides what is due (src/update/exact_on_host.cpp).
#pragma once

#include <cstddef>

namespace accessvdb::kernels {

// launch/due_update.h
struct DueUpdate;
struct DueTask;
struct DueOutcome;

/// Evaluates points by hostdev/due_evaluation.h. Not valid beyond the update.
class DueEvaluator {
 public:
  virtual ~DueEvaluator() = default;
  /// From any thread, also at the same time for other points. Fastest if the points of a block follow each other.
  /// @param tasks, outcomes  [count] ids differ
  virtual void evaluate(const DueTask* tasks, DueOutcome* outcomes, std::size_t count) = 0;
};

}  // namespace accessvdb::kernels
