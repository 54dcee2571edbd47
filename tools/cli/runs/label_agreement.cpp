// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/label_agreement.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"

namespace accessvdb::tools {
namespace {

constexpr auto kAccessible = static_cast<std::size_t>(PointLabel::Accessible);
constexpr auto kBlocked = static_cast<std::size_t>(PointLabel::Blocked);

double percentOf(std::uint64_t part, std::uint64_t whole) {
  return whole == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(whole);
}

/// A surface point, by its world voxel.
struct PlacedLabel {
  std::array<std::int64_t, 3> voxel;
  PointLabel label;
};

/// Origins are multiples of a voxel in the world, so maps with different origins share one grid. The point's voxel is
/// that of the map: the position in the map's own frame, as float, to the nearest integer.
std::vector<PlacedLabel> placed(const FieldSnapshot& field) {
  const double v = field.voxel_size_m;
  std::vector<PlacedLabel> labels(field.points.size());
  for (std::size_t n = 0; n < labels.size(); ++n) {
    const Eigen::Vector3f p_L = (field.points[n].position_W - field.origin_W).cast<float>();
    for (int axis = 0; axis < 3; ++axis) {
      labels[n].voxel[static_cast<std::size_t>(axis)] =
          static_cast<std::int64_t>(std::floor(static_cast<double>(p_L[axis]) / v + 0.5)) +
          std::llround(field.origin_W[axis] / v);
    }
    labels[n].label = field.points[n].label;
  }
  std::sort(labels.begin(), labels.end(), [](const PlacedLabel& a, const PlacedLabel& b) { return a.voxel < b.voxel; });
  return labels;
}

/// Maps every `stride`-th scan from `first` on. @return none if stopped
std::optional<FieldSnapshot> mapPart(io::ScanSequence& scans, std::size_t first, std::size_t stride, const char* name,
                                     const ToolGeometry& tool, const FieldParams& params, const ConsistencyHooks& hooks,
                                     ConsistencyPart& part) {
  const auto start = std::chrono::steady_clock::now();
  AccessibilityField field(tool, params);
  const std::size_t total = (scans.size() - first + stride - 1) / stride;
  for (std::size_t step = first; step < scans.size(); step += stride) {
    if (hooks.stop && hooks.stop()) return std::nullopt;
    const io::ScanRecord record = scans.read(step);
    const FrameStats stats = record.points_W.empty() ? field.integrateScan(record.points_S, record.T_W_S)
                                                     : field.integrateRays(record.points_W, record.origins_W);
    ++part.scans;
    part.points_in += stats.points_in;
    part.points_used += stats.points_used;
    if (hooks.progress) hooks.progress(name, part.scans, total);
  }
  if (part.points_used == 0) {
    throw UnusableInput("scans.no_returns", name,
                        "none of the " + std::to_string(part.points_in) + " returns of these scans can be used",
                        "Check the scans, --min-range and --max-range");
  }
  field.update();
  FieldSnapshot snapshot = field.snapshot();
  for (std::size_t label = 0; label < part.labels.size(); ++label) {
    part.labels[label] = snapshot.count(static_cast<PointLabel>(label));
  }
  part.reasons = snapshot.reasons();
  part.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return snapshot;
}

}  // namespace

std::uint64_t LabelAgreement::compared() const {
  return voxels[kAccessible][kAccessible] + voxels[kAccessible][kBlocked] + voxels[kBlocked][kAccessible] +
         voxels[kBlocked][kBlocked];
}
std::uint64_t LabelAgreement::notCompared() const {
  std::uint64_t all = only_first + only_second;
  for (const auto& row : voxels)
    for (const std::uint64_t count : row) all += count;
  return all - compared();
}
double LabelAgreement::agreementPercent() const {
  return percentOf(voxels[kAccessible][kAccessible] + voxels[kBlocked][kBlocked], compared());
}
double LabelAgreement::accessiblePercentOfFirst() const {
  return percentOf(voxels[kAccessible][kAccessible] + voxels[kAccessible][kBlocked], compared());
}
double LabelAgreement::accessiblePercentOfSecond() const {
  return percentOf(voxels[kAccessible][kAccessible] + voxels[kBlocked][kAccessible], compared());
}
double LabelAgreement::precisionPercent() const {
  return percentOf(voxels[kAccessible][kAccessible], voxels[kAccessible][kAccessible] + voxels[kAccessible][kBlocked]);
}
double LabelAgreement::recallPercent() const {
  return percentOf(voxels[kAccessible][kAccessible], voxels[kAccessible][kAccessible] + voxels[kBlocked][kAccessible]);
}

std::optional<double> LabelAgreement::kappa() const {
  if (compared() == 0) return std::nullopt;
  const double agree = agreementPercent() / 100;
  const double first = accessiblePercentOfFirst() / 100, second = accessiblePercentOfSecond() / 100;
  const double by_chance = first * second + (1 - first) * (1 - second);
  if (!(by_chance < 1)) return std::nullopt;
  return (agree - by_chance) / (1 - by_chance);
}

LabelAgreement compareByVoxel(const FieldSnapshot& first, const FieldSnapshot& second) {
  if (first.voxel_size_m != second.voxel_size_m || !(first.voxel_size_m > 0)) {
    throw InvalidArgument("consistency.voxel", "", "the two fields have different voxel sizes",
                          "Map both with the same --voxel");
  }
  const std::vector<PlacedLabel> a = placed(first), b = placed(second);
  LabelAgreement agreement;
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (a[i].voxel < b[j].voxel) {
      ++agreement.only_first;
      ++i;
    } else if (b[j].voxel < a[i].voxel) {
      ++agreement.only_second;
      ++j;
    } else {
      ++agreement.voxels[static_cast<std::size_t>(a[i++].label)][static_cast<std::size_t>(b[j++].label)];
    }
  }
  agreement.only_first += a.size() - i;
  agreement.only_second += b.size() - j;
  return agreement;
}

std::optional<ConsistencyResult> measureConsistency(io::ScanSequence& scans, const ToolGeometry& tool,
                                                    const FieldParams& params, const ConsistencyHooks& hooks) {
  if (scans.size() < 2) {
    throw UnusableInput(
        "consistency.scans", "",
        "there is only " + std::to_string(scans.size()) + " scan, which cannot be split into two halves",
        "Use two or more scans");
  }
  ConsistencyResult result;
  const auto even = mapPart(scans, 0, 2, "even scans", tool, params, hooks, result.even);
  if (!even) return std::nullopt;
  const auto odd = mapPart(scans, 1, 2, "odd scans", tool, params, hooks, result.odd);
  if (!odd) return std::nullopt;
  const auto all = mapPart(scans, 0, 1, "all scans", tool, params, hooks, result.all);
  if (!all) return std::nullopt;
  result.even_odd = compareByVoxel(*even, *odd);
  result.even_all = compareByVoxel(*even, *all);
  result.odd_all = compareByVoxel(*odd, *all);
  return result;
}

}  // namespace accessvdb::tools
