// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scoring without a field: a backend with the test's own map, tool and points.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "field/tools/scoring_setup.h"
#include "launch/backend.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/random_world.h"
#include "update/point_scorer.h"

namespace accessvdb::test {

/// Everything that a backend is given; the same for every backend under test.
struct ScoringCase {
  FieldParams params;  ///< resolved
  ToolGeometry tool;
  std::vector<std::vector<LeafChange>> changes;  ///< batches
  std::vector<kernels::PointInput> inputs;       ///< id = place
  std::vector<std::uint64_t> wide_seen;          ///< of a wide set: seen directions, row by row
  std::vector<kernels::ScoreItem> items;         ///< ids differ
};

/// A random map around the tool's reach, points with random normals and views in it, and items of every kind that sets
/// of this size know.
[[nodiscard]] ScoringCase randomCase(Random& random, const ToolGeometry& tool, const FieldParams& params, int points);

/// The stored state of all points.
struct StoredState {
  std::vector<std::uint16_t> score, direction;
  std::vector<std::uint8_t> roll;  ///< empty if the tool does not roll
  std::vector<float> stability;
  std::vector<PointLabel> label;
  std::vector<PointReason> reason;
};

class ScoringRig {
 public:
  ScoringRig(std::unique_ptr<kernels::Backend> backend, const ScoringCase& what);

  [[nodiscard]] kernels::ScoreRequest request(bool keep_best) const;
  [[nodiscard]] std::vector<kernels::ScoreResult> score(std::span<const kernels::ScoreItem> items, bool keep_best);
  [[nodiscard]] StoredState state() const;

  [[nodiscard]] kernels::Backend& backend() { return *backend_; }
  [[nodiscard]] internal::NanoVdbMirror& mirror() { return mirror_; }
  [[nodiscard]] const internal::ScoringSetup& setup() const { return setup_; }

 private:
  std::unique_ptr<kernels::Backend> backend_;
  internal::ScoringSetup setup_;
  internal::NanoVdbMirror mirror_;
  internal::PointsOnDevice points_;
};

/// Field for field, except which blocked directions were counted far enough to be known as such: that is up to the
/// backend (expectBlockedIsTrue). The first difference fails the test and is named.
void expectSameResults(std::span<const kernels::ScoreResult> a, std::span<const kernels::ScoreResult> b);
/// Directions reported as blocked by the tool have at least the reported collisions, and enough, by plain counts.
/// @param cpu  a rig of the same case on the CPU
void expectBlockedIsTrue(const ScoringRig& cpu, std::span<const kernels::ScoreItem> items,
                         std::span<const kernels::ScoreResult> results);
void expectSameState(const StoredState& a, const StoredState& b);

}  // namespace accessvdb::test
