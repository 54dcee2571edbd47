// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is known of a cell of 4^3 voxels that has surface points: how often rays returned from it, and how many passed
/// (docs/design/change.md, "Gone by evidence").
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>

#include "points/surface_index.h"

namespace accessvdb::internal {

enum class Verdict : std::uint8_t {
  Stands,
  Gone,  ///< each ray through one of its voxels opens that voxel
  Open   ///< gone, and nothing is left that a ray could open
};

struct CellRecord {
  std::uint64_t lines = 0;     ///< those of the passes since the last hit, a hash of six bits each
  std::uint32_t hits = 0;      ///< [h] scans and voxels with a return
  std::uint32_t missed = 0;    ///< [m] passes that a hit followed
  std::uint32_t emptied = 0;   ///< lines that were counted before `lines` was emptied
  std::uint32_t followed = 0;  ///< what the next hit adds to `missed`
  std::uint16_t scans = 0;     ///< with passes since the last hit
  Verdict verdict = Verdict::Stands;

  /// Passes along different lines since the last hit. The set of 64 fills like any hash: of k bits, 64 ln(64 / (64-k))
  /// lines are expected.
  [[nodiscard]] std::uint32_t passes() const {
    static constexpr std::array<std::uint8_t, kFullSet + 1> kLines = {
        0,  1,  2,  3,  4,  5,  6,  7,  9,  10, 11, 12, 13, 15, 16, 17, 18, 20, 21, 23, 24, 25, 27, 28, 30,
        32, 33, 35, 37, 39, 40, 42, 44, 46, 48, 51, 53, 55, 58, 60, 63, 65, 68, 71, 74, 78, 81, 85, 89};
    return emptied + kLines[static_cast<std::size_t>(std::popcount(lines))];
  }
  /// @param of_scan  the lines of one scan  @param weight  how many rays each stands for
  void addPasses(std::uint64_t of_scan, std::uint32_t weight) {
    const std::uint32_t before = passes();
    lines |= of_scan;
    if (std::popcount(lines) >= kFullSet) {
      emptied = std::min(emptied + 89, kMost);
      lines = 0;
    }
    followed = std::min(followed + (passes() - std::min(before, passes())) * weight, kMost);
    scans = static_cast<std::uint16_t>(std::min(scans + 1, 0xffff));
  }
  void addHits(std::uint32_t count) {
    hits = std::min(hits + count, kMost);
    missed = std::min(missed + followed, kMost);
    lines = 0;
    emptied = followed = 0;
    scans = 0;
    verdict = Verdict::Stands;
  }

  bool operator==(const CellRecord&) const = default;

  static constexpr int kFullSet = 48;
  static constexpr std::uint32_t kMost = 1u << 24;
};
static_assert(sizeof(CellRecord) == 32);

/// The cells of one leaf.
using LeafCells = std::array<CellRecord, 8>;

/// Which of the leaf's cells a voxel is in. @param bit  of the voxel in its leaf (bitInParent)
constexpr std::size_t cellOfBit(std::size_t bit) { return (bit >> 8 & 1) << 2 | (bit >> 5 & 1) << 1 | (bit >> 2 & 1); }
inline constexpr int kCellEdge = 4;  ///< voxels
/// Index of a voxel's cell, over the whole map.
inline Index3 cellOfVoxel(const Index3& voxel) { return {voxel[0] >> 2, voxel[1] >> 2, voxel[2] >> 2}; }
/// Its lowest voxel.
inline Index3 voxelOfCell(const Index3& cell) {
  return {kCellEdge * cell[0], kCellEdge * cell[1], kCellEdge * cell[2]};
}
inline std::size_t cellInLeaf(const Index3& cell) {
  return static_cast<std::size_t>((cell[0] & 1) << 2 | (cell[1] & 1) << 1 | (cell[2] & 1));
}

/// Evidence enough for a verdict, by the cell's own rate of hits; a run of misses as long as any constant would be met
/// by foliage sooner or later.
struct GoneRule {
  static constexpr std::uint64_t kFactor = 30;        ///< passes for every ray that would have returned
  static constexpr std::uint64_t kPooledFactor = 60;  ///< the same for a cell and its neighbours together
  static constexpr std::uint16_t kScans = 3;

  static bool isEnough(std::uint64_t factor, std::uint64_t passes, std::uint64_t hits, std::uint64_t missed) {
    return hits >= 2 && passes * (hits - 1) >= factor * (hits + missed + 3);
  }
  /// All rays are examined, not only some, once passes pile up.
  static bool isSuspect(const CellRecord& cell) {
    return cell.verdict == Verdict::Stands && cell.scans >= 2 && cell.passes() >= 8;
  }
};

}  // namespace accessvdb::internal
