// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/agreement/scan_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace accessvdb::io {
namespace {

/// From less than a degree to eleven: as fine as the returns of a scan lie.
constexpr std::array<int, 9> kEdges = {128, 90, 64, 45, 32, 22, 16, 11, 8};
/// Returns per cell that has any: with fewer, neighbours are in cells that are not beside each other.
constexpr std::size_t kReturnsPerCell = 2;
/// Cells of the 3 x 3 around a direction that must have returns, so that a gap between rays does not count as free.
constexpr int kCellsAround = 4;
/// Rows of a scanner may be so many cells apart.
constexpr int kGapCells = 4;

struct FaceCell {
  int face, column, row;
};

/// Faces in the order -x +x -y +y -z +z; cells of equal width on the plane, so those in corners are smaller.
FaceCell faceCell(const Eigen::Vector3f& p, int edge) {
  int axis = 0;
  const Eigen::Vector3f a = p.cwiseAbs();
  if (a[1] > a[axis]) axis = 1;
  if (a[2] > a[axis]) axis = 2;
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const float half = 0.5F * static_cast<float>(edge) / a[axis];
  const auto cell = [&](float value) {
    return std::clamp(static_cast<int>(value * half + 0.5F * static_cast<float>(edge)), 0, edge - 1);
  };
  return {2 * axis + (p[axis] > 0 ? 1 : 0), cell(p[u]), cell(p[v])};
}

std::size_t indexOf(const FaceCell& cell, int stride) {
  return (static_cast<std::size_t>(cell.face) * static_cast<std::size_t>(stride) + static_cast<std::size_t>(cell.row) +
          1) *
             static_cast<std::size_t>(stride) +
         static_cast<std::size_t>(cell.column) + 1;
}

}  // namespace

std::size_t ScanView::cellOf(const Eigen::Vector3f& p_S) const { return indexOf(faceCell(p_S, edge_cells_), stride_); }

ScanView::ScanView(const std::vector<Eigen::Vector3f>& returns_S) {
  constexpr Span kNone = {std::numeric_limits<float>::infinity(), 0};
  for (const int edge : kEdges) {
    edge_cells_ = edge;
    stride_ = edge + 2;
    cells_.assign(6 * static_cast<std::size_t>(stride_) * static_cast<std::size_t>(stride_), kNone);
    std::size_t occupied = 0;
    for (const Eigen::Vector3f& p_S : returns_S) {
      Span& cell = cells_[cellOf(p_S)];
      occupied += cell.farthest == 0 ? 1 : 0;
      const float range_m = p_S.norm();
      cell = {std::min(cell.nearest, range_m), std::max(cell.farthest, range_m)};
    }
    if (returns_S.size() >= kReturnsPerCell * occupied) break;
  }
  width_rad_ = std::numbers::pi_v<float> / 2 / static_cast<float>(edge_cells_);
}

bool ScanView::seesAround(const Eigen::Vector3f& p_S) const {
  const FaceCell cell = faceCell(p_S, edge_cells_);
  for (int row = std::max(0, cell.row - kGapCells); row <= std::min(edge_cells_ - 1, cell.row + kGapCells); ++row)
    for (int column = std::max(0, cell.column - kGapCells);
         column <= std::min(edge_cells_ - 1, cell.column + kGapCells); ++column)
      if (cells_[indexOf({cell.face, column, row}, stride_)].farthest > 0) return true;
  return false;
}

ScanView::Answer ScanView::at(const Eigen::Vector3f& p_S, float three_sigma_m) const {
  const float range_m = p_S.norm();
  if (!(range_m > 0) || !(range_m < std::numeric_limits<float>::infinity())) return Answer::Nothing;
  const float tolerance_m = three_sigma_m + width_rad_ * range_m;
  const std::size_t middle = cellOf(p_S);
  float nearest = std::numeric_limits<float>::infinity(), farthest = 0;
  int occupied = 0;
  for (int row = -1; row <= 1; ++row) {
    for (int column = -1; column <= 1; ++column) {
      const Span& cell = cells_[middle + static_cast<std::size_t>(row * stride_ + column)];
      if (cell.farthest == 0) continue;
      if (cell.nearest <= range_m + tolerance_m && cell.farthest >= range_m - tolerance_m) return Answer::Surface;
      ++occupied;
      nearest = std::min(nearest, cell.nearest);
      farthest = std::max(farthest, cell.farthest);
    }
  }
  if (occupied == 0) return seesAround(p_S) ? Answer::Unknown : Answer::Nothing;
  if (occupied < kCellsAround || cells_[middle].farthest == 0) return Answer::Unknown;
  if (farthest < range_m) return Answer::Hidden;
  return nearest > range_m ? Answer::Free : Answer::Unknown;
}

}  // namespace accessvdb::io
