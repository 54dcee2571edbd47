// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What would a cut open? Which points the tool would reach if parts of the map went, without changing it
/// (AccessibilityField::whatIf()), and in which order to cut. docs/design/change.md, "By hand".
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/region.h"
#include "accessvdb/types.h"

namespace accessvdb {

class AccessibilityField;

struct WhatIf {
  /// Points that are blocked now and would be accessible, by id, with label, direction and score as they would be.
  std::vector<SurfacePoint> opens;
  std::uint64_t voxels = 0;            ///< observed voxels of the regions
  std::uint64_t colliding_voxels = 0;  ///< those that block the tool
  std::uint64_t points_gone = 0;       ///< surface points in them, which would be gone
  std::uint64_t points_tried = 0;      ///< blocked points near enough to be tried again
  std::uint64_t direction_tests = 0;
  double choose_ms = 0;  ///< finding the voxels and those points
  double score_ms = 0;   ///< trying them
};

/// Something that can be cut by itself.
struct Segment {
  std::string name;
  Region region;
};

/// One step of an order of cuts.
struct Cut {
  std::size_t segment = 0;           ///< index
  std::vector<std::uint32_t> opens;  ///< ids that this cut opens, after those before it
  std::uint64_t points_gone = 0;     ///< surface points that go with it
};

struct CutOrder {
  std::vector<Cut> cuts;
  /// Segments that open nothing by themselves once the cuts are made.
  std::vector<std::size_t> left;
  /// Points that those would open if all of them went together: pairs that open only together are among them.
  std::uint64_t left_together = 0;
  std::uint64_t what_ifs = 0;  ///< evaluations that it took
};

/// What a labelled point cloud can be cut into, in the order of the labels.
struct LabelledSegments {
  std::vector<Segment> segments;  ///< named by their labels; surface points by id
  std::uint64_t unlabelled = 0;   ///< positions with a label of 0 or below
  std::uint64_t unmatched = 0;    ///< positions farther than a voxel's diagonal from every surface point
};
/// Each position's label goes to the surface point of its voxel, else to the nearest within a voxel's diagonal. A
/// surface point with several labels belongs to the most frequent one, then to the smallest.
/// @param positions_W, labels  [n]  @throws InvalidArgument "segments.sizes" if the lengths differ
[[nodiscard]] ACCESSVDB_API LabelledSegments segmentsOf(const AccessibilityField& field,
                                                        std::span<const Eigen::Vector3d> positions_W,
                                                        std::span<const std::int64_t> labels);

/// Greedy: each step cuts the segment that adds most to the points that are open, the first of several, until none adds
/// any. A point that opens only if two segments go is not found by this as long as neither of them opens others.
/// @param most_cuts  stops after so many; 0: no limit
/// @throws as AccessibilityField::whatIf()
[[nodiscard]] ACCESSVDB_API CutOrder orderCuts(const AccessibilityField& field, std::span<const Segment> segments,
                                               std::size_t most_cuts = 0);

}  // namespace accessvdb
