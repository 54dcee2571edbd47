// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Comparing two maps point by point. The earlier one is kept as a list sorted by voxel; the later one is read past it.
#include "accessvdb/program/points_diff.h"

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <tuple>

#include "accessvdb/error.h"
#include "io/streams/voxel_rule.h"

namespace accessvdb::io {
namespace {

using Voxel = std::array<std::int32_t, 3>;

/// A point of the earlier map, 48 bytes.
struct Earlier {
  Eigen::Vector3d position_W;
  Voxel voxel;
  std::uint32_t tools;
  PointLabel label;
  PointReason reason;
  bool met = false;  ///< a point of the later map could be its counterpart
};

/// As operator<, which calls memcmp for each of the comparisons that a diff mostly consists of.
bool isBefore(const Voxel& a, const Voxel& b) {
  if (a[0] != b[0]) return a[0] < b[0];
  if (a[1] != b[1]) return a[1] < b[1];
  return a[2] < b[2];
}

bool beforeInSpace(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::tie(a.x(), a.y(), a.z()) < std::tie(b.x(), b.y(), b.z());
}

/// By voxel, then by position: an order that no division into files changes.
bool before(const Earlier& a, const Earlier& b) {
  if (isBefore(a.voxel, b.voxel)) return true;
  return !isBefore(b.voxel, a.voxel) && beforeInSpace(a.position_W, b.position_W);
}

/// The header that all files of a map share.
PointsHeader commonHeader(const std::vector<std::filesystem::path>& files) {
  std::optional<PointsHeader> common;
  for (const std::filesystem::path& file : files) {
    PointsHeader header = readPointsHeader(file);
    if (!common) {
      common = std::move(header);
    } else if (header.origin_W != common->origin_W || header.voxel_size_m != common->voxel_size_m) {
      throw UnusableInput("diff.parts", file.string(), "has another origin or voxel size than " + files[0].string(),
                          "Give the tiles of one map only");
    } else {
      common->points += header.points;
    }
  }
  if (!common) {
    throw UnusableInput("diff.parts", "", "a map without files cannot be compared", "Give at least one points.ply");
  }
  return *common;
}

std::optional<std::string> valueOf(const FieldMetadata& metadata, const std::string& key) {
  for (const auto& [name, value] : metadata) {
    if (name == key) return value;
  }
  return std::nullopt;
}

std::string millimetres(double metres) { return std::to_string(metres * 1e3) + " mm"; }

/// What must agree, and the names of what else differs.
std::vector<std::string> checkComparable(const PointsHeader& a, const PointsHeader& b) {
  if (a.voxel_size_m != b.voxel_size_m) {
    throw UnusableInput(
        "diff.voxel", "",
        "the maps have voxels of " + millimetres(a.voxel_size_m) + " and " + millimetres(b.voxel_size_m),
        "Map both with the same voxel_size_m");
  }
  const auto tool_a = valueOf(a.metadata, "tool_sha256"), tool_b = valueOf(b.metadata, "tool_sha256");
  if (!tool_a || !tool_b || *tool_a != *tool_b) {
    throw UnusableInput(
        "diff.tool", "",
        !tool_a || !tool_b ? "a map does not say which tool it is for" : "the maps are of different tools",
        "Map both with the same tool");
  }
  std::vector<std::string> names, others;
  for (const FieldMetadata* metadata : {&a.metadata, &b.metadata}) {
    for (const auto& [name, value] : *metadata) {
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    }
  }
  // Where and by which program a map was made changes no label.
  static const std::set<std::string> kNoParameters = {"device", "accessvdb_version", "tool", "input", "AccessVDB"};
  for (const std::string& name : names) {
    const auto of_a = valueOf(a.metadata, name), of_b = valueOf(b.metadata, name);
    if (of_a == of_b || kNoParameters.contains(name)) continue;
    others.push_back(name + ": " + of_a.value_or("-") + ", " + of_b.value_or("-"));
  }
  return others;
}

/// Points of the earlier map by voxel. Voxels count from its origin.
class EarlierPoints {
 public:
  EarlierPoints(const std::vector<std::filesystem::path>& files, const PointsHeader& header, PointMatch match)
      : origin_W_(header.origin_W), voxel_size_m_(header.voxel_size_m), match_(match) {
    points_.reserve(header.points);
    for (const std::filesystem::path& file : files) {
      visitPoints(file, [&](const SurfacePoint& point) {
        points_.push_back({point.position_W, voxelOf(point.position_W), point.tools, point.label, point.reason});
      });
    }
    tbb::parallel_sort(points_.begin(), points_.end(), [](const Earlier& a, const Earlier& b) { return before(a, b); });
  }

  /// The counterpart of a point of the later map, if any; marks all that could be.
  const Earlier* counterpartOf(const Eigen::Vector3d& p_W) {
    const Voxel centre = voxelOf(p_W);
    const std::int32_t reach = match_ == PointMatch::SameVoxel ? 0 : 1;
    const Earlier* best = nullptr;
    double least = 0;
    for (std::int32_t dx = -reach; dx <= reach; ++dx) {
      for (std::int32_t dy = -reach; dy <= reach; ++dy) {
        const Voxel low = {centre[0] + dx, centre[1] + dy, centre[2] - reach};
        const std::int32_t last_z = centre[2] + reach;
        auto at = std::lower_bound(points_.begin(), points_.end(), low, [](const Earlier& point, const Voxel& voxel) {
          return isBefore(point.voxel, voxel);
        });
        for (; at != points_.end() && at->voxel[0] == low[0] && at->voxel[1] == low[1] && at->voxel[2] <= last_z;
             ++at) {
          const double distance = (at->position_W - p_W).squaredNorm();
          if (match_ == PointMatch::Nearest && !(distance <= voxel_size_m_ * voxel_size_m_)) continue;
          at->met = true;
          const bool nearer = distance < least ||
                              (distance == least && best != nullptr && beforeInSpace(at->position_W, best->position_W));
          if (best == nullptr || nearer) best = &*at, least = distance;
        }
      }
    }
    return best;
  }

  [[nodiscard]] const std::vector<Earlier>& points() const { return points_; }

 private:
  /// Beyond 2^30 voxels, where no map reaches, all share the outermost ones.
  [[nodiscard]] Voxel voxelOf(const Eigen::Vector3d& p_W) const {
    constexpr double kLast = 1 << 30;
    Voxel voxel;
    for (int axis = 0; axis < 3; ++axis) {
      const double place = internal::voxelOfCoordinate(p_W[axis] - origin_W_[axis], voxel_size_m_);
      voxel[axis] = static_cast<std::int32_t>(std::clamp(place, -kLast, kLast));
    }
    return voxel;
  }

  Eigen::Vector3d origin_W_;
  double voxel_size_m_;
  PointMatch match_;
  std::vector<Earlier> points_;
};

void countTools(std::uint32_t before, std::uint32_t after, std::vector<PointsDiff::ToolChange>& tools) {
  for (std::size_t k = 0; k < tools.size(); ++k) {
    const bool was = (before >> k & 1) != 0, is = (after >> k & 1) != 0;
    if (is && !was) ++tools[k].opened;
    if (was && !is) ++tools[k].closed;
  }
}

PointChange changeOf(PointLabel before, PointLabel after) {
  if (after == PointLabel::Accessible) return PointChange::Opened;
  return before == PointLabel::Accessible ? PointChange::Closed : PointChange::Relabelled;
}

/// By place, then by everything else that distinguishes two changes at one place.
bool inOrder(const ChangedPoint& a, const ChangedPoint& b) {
  if (a.point.position_W != b.point.position_W) return beforeInSpace(a.point.position_W, b.point.position_W);
  return std::tuple(a.change, a.label_before, a.point.label) < std::tuple(b.change, b.label_before, b.point.label);
}

std::vector<PointsDiff::Transition> transitionsOf(const std::vector<ChangedPoint>& points) {
  std::map<std::tuple<PointLabel, PointReason, PointLabel, PointReason>, std::uint64_t> counts;
  for (const ChangedPoint& changed : points) {
    if (changed.change == PointChange::Appeared || changed.change == PointChange::Gone) continue;
    ++counts[{changed.label_before, changed.reason_before, changed.point.label, changed.point.reason}];
  }
  std::vector<PointsDiff::Transition> list;
  for (const auto& [key, count] : counts) {
    const auto& [label_before, reason_before, label_after, reason_after] = key;
    list.push_back({label_before, label_after, reason_before, reason_after, count});
  }
  std::stable_sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.points > b.points; });
  return list;
}

}  // namespace

PointsDiff diffPoints(const std::vector<std::filesystem::path>& before,
                      const std::vector<std::filesystem::path>& after) {
  const PointsHeader header = commonHeader(before), later = commonHeader(after);
  PointsDiff diff;
  diff.other_parameters = checkComparable(header, later);
  diff.match = header.origin_W == later.origin_W ? PointMatch::SameVoxel : PointMatch::Nearest;
  diff.origin_W = header.origin_W;
  diff.voxel_size_m = header.voxel_size_m;
  std::istringstream names(valueOf(later.metadata, "tools").value_or(""));
  for (std::string name; std::getline(names, name, ',');) diff.tools.push_back({name});

  EarlierPoints earlier(before, header, diff.match);
  diff.points_before = earlier.points().size();
  for (const std::filesystem::path& file : after) {
    visitPoints(file, [&](const SurfacePoint& point) {
      ++diff.points_after;
      const Earlier* counterpart = earlier.counterpartOf(point.position_W);
      if (counterpart != nullptr) countTools(counterpart->tools, point.tools, diff.tools);
      if (counterpart == nullptr) {
        diff.points.push_back({PointChange::Appeared, PointLabel::Unscored, PointReason::Confidence, point});
      } else if (counterpart->label == point.label) {
        ++diff.same;
      } else {
        diff.points.push_back(
            {changeOf(counterpart->label, point.label), counterpart->label, counterpart->reason, point});
      }
    });
  }
  for (const Earlier& point : earlier.points()) {
    if (point.met) continue;
    SurfacePoint gone;
    gone.position_W = point.position_W;
    gone.label = point.label;
    gone.reason = point.reason;
    diff.points.push_back({PointChange::Gone, point.label, point.reason, gone});
  }
  tbb::parallel_sort(diff.points.begin(), diff.points.end(), inOrder);
  for (const ChangedPoint& changed : diff.points) ++diff.changes[static_cast<std::size_t>(changed.change)];
  diff.transitions = transitionsOf(diff.points);
  return diff;
}

}  // namespace accessvdb::io
