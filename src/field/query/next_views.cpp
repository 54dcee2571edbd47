// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/next_views.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <utility>

#include "accessvdb/access_map.h"
#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/error.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tool_spec.h"
#include "field/field_access.h"
#include "field/query/view_gain.h"
#include "field/tools/tools_of_field.h"
#include "points/point_store.h"

namespace accessvdb {
namespace {

using internal::KnownSpace;
using internal::OpenPoint;
using internal::OpenWay;
using internal::SensorPose;
using internal::ViewGain;
using internal::ViewRules;

/// Points by which poses are compared, and those from which the answer is counted.
constexpr std::size_t kCompared = 512, kCounted = 2048;
/// Directions of all points whose outcome is held at once.
constexpr std::size_t kMostOutcomes = 2'000'000;
/// Cells of free space of which each gives a place to compare, and places that are tried in a cell until the body fits.
constexpr std::size_t kMostCells = 512, kTriedInCell = 32;
/// Headings of a sensor that does not look all around, or is pitched: at least so many.
constexpr int kHeadings = 8;
/// Fewer returns than this in a voxel, and a place is too far to look at it.
constexpr double kLeastReturns = 0.01;
/// Points whose ways to the sensor are walked.
constexpr std::size_t kWaysOfReturns = 4000;
/// A view that is expected to resolve fewer points than this is none.
constexpr double kFewestPoints = 0.5;
constexpr double kDefaultBody_m = 0.3, kDefaultTravel_m = 10;

/// As a random order of ids, or of places, that is always the same.
std::uint64_t mixed(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15U;
  x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9U;
  x = (x ^ x >> 27) * 0x94D049BB133111EBU;
  return x ^ x >> 31;
}
std::uint64_t mixed(const openvdb::Coord& ijk) {
  std::uint64_t x = 0;
  for (int axis = 0; axis < 3; ++axis) x = mixed(x ^ static_cast<std::uint32_t>(ijk[axis]));
  return x;
}

void requireSensor(const ViewSensor& sensor) {
  const auto require = [](bool fine, const char* field, const char* words, const char* advice) {
    if (!fine) throw InvalidArgument("views.field_of_view", field, words, advice);
  };
  constexpr double kHalfTurn = std::numbers::pi, kMore = 1e-9;
  require(sensor.azimuth_rad > 0 && sensor.azimuth_rad <= 2 * kHalfTurn + kMore, "ViewSensor::azimuth_rad",
          "is no width of a view", "Use more than 0, up to a whole turn");
  require(sensor.elevation_min_rad < sensor.elevation_max_rad && sensor.elevation_min_rad >= -kHalfTurn / 2 - kMore &&
              sensor.elevation_max_rad <= kHalfTurn / 2 + kMore,
          "ViewSensor::elevation_min_rad", "is not below the highest elevation, or beyond 90 degrees",
          "Use the lower one first, within -90 to 90 degrees");
  require(!sensor.pitches_rad.empty() && sensor.pitches_rad.size() <= 32 &&
              std::ranges::all_of(sensor.pitches_rad,
                                  [](double pitch) { return std::abs(pitch) <= kHalfTurn / 2 + kMore; }),
          "ViewSensor::pitches_rad", "are not 1 to 32 angles within -90 to 90 degrees", "Use 0 for a level sensor");
  require(sensor.rays >= 1 && sensor.rays <= 1e9, "ViewSensor::rays", "is outside 1 .. 1e9",
          "Use what it measures while it stays, as 200000");
  require(sensor.max_range_m > 0, "ViewSensor::max_range_m", "is no range", "Use metres");
}

Eigen::Matrix3d heldAt(double yaw_rad, double pitch_rad) {
  return (Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()) *
          Eigen::AngleAxisd(-pitch_rad, Eigen::Vector3d::UnitY()))
      .toRotationMatrix();
}

/// A pose to be compared.
struct CandidateView {
  SensorPose pose;
  double gain = 0;        ///< of the compared points, in points, at most
  std::size_t round = 0;  ///< of the choice in which that was computed
};

class ViewSearch {
 public:
  ViewSearch(const AccessibilityField& field, const ViewOptions& given)
      : field_(field),
        options_(given),
        params_(field.params()),
        voxel_size_m_(params_.tsdf.voxel_size_m),
        arena_(params_.threads > 0 ? params_.threads : static_cast<int>(tbb::task_arena::automatic)) {
    requireSensor(options_.sensor);
    if (options_.body_radius_m == 0) {
      const double platform_m = params_.tsdf.platform_radius_m;
      options_.body_radius_m = platform_m > 0 ? platform_m : kDefaultBody_m;
    }
    if (options_.travel_m == 0) options_.travel_m = kDefaultTravel_m;
    const auto require = [](bool fine, const char* option, const char* words) {
      if (!fine) throw InvalidArgument("views.options", option, words, "Leave it out for the rule");
    };
    require(options_.body_radius_m > 0 && options_.body_radius_m <= 100, "ViewOptions::body_radius_m",
            "is outside 0 .. 100 m");
    require(options_.travel_m > 0, "ViewOptions::travel_m", "is not a distance");
    require(options_.within_m >= 0, "within_m", "is not a distance");
    require(!options_.from_W || options_.from_W->allFinite(), "from_W", "is not finite");
    if (std::isfinite(options_.within_m) && !options_.from_W) {
      throw InvalidArgument("views.options", "within_m", "says how far, and from_W does not say from where",
                            "Give both");
    }
  }

  [[nodiscard]] NextViews run() {
    if (internal::FieldAccess::map(field_).leaf_count == 0)
      throw UnusableInput("views.no_map", "", "the map has no scans", "Map a scan first");
    arena_.execute([&] {
      collect();
      space_.emplace(internal::FieldAccess::map(field_));
      rules_.emplace(params_, options_.sensor);
      openvdb::CoordBBox all;
      if (space_->tree().evalLeafBoundingBox(all)) rules_->max_range = std::min(rules_->max_range, diagonalOf(all));
      measurePassing();
      open();
      findCandidates();
      choose();
    });
    return std::move(found_);
  }

 private:
  static double diagonalOf(const openvdb::CoordBBox& box) {
    return Eigen::Vector3d(box.dim().x(), box.dim().y(), box.dim().z()).norm();
  }
  [[nodiscard]] Eigen::Vector3d placeOf(const Eigen::Vector3d& p_W) const {
    return (p_W - field_.origin_W()) / voxel_size_m_ + Eigen::Vector3d::Constant(0.5);
  }
  [[nodiscard]] Eigen::Vector3d positionOf(const Eigen::Vector3d& place) const {
    return field_.origin_W() + voxel_size_m_ * (place - Eigen::Vector3d::Constant(0.5));
  }

  void collect();
  void measurePassing();
  void open();
  [[nodiscard]] OpenPoint openPoint(const AccessMap& map, PointReason reason) const;
  void findCandidates();
  void addPoses(const Eigen::Vector3d& place);
  void choose();
  [[nodiscard]] double gainOf(const SensorPose& pose) const;
  [[nodiscard]] double worthOf(const CandidateView& candidate) const;
  void add(const CandidateView& chosen);

  struct Unresolved {
    std::uint32_t id;
    std::size_t tool;
    PointReason reason;
  };

  const AccessibilityField& field_;
  ViewOptions options_;
  FieldParams params_;
  double voxel_size_m_;
  tbb::task_arena arena_;
  NextViews found_;
  std::vector<Unresolved> sampled_;
  double points_per_sample_ = 0;  ///< of points_
  std::size_t compared_ = 0;      ///< the first of points_
  std::vector<OpenPoint> points_;
  std::optional<KnownSpace> space_;
  std::optional<ViewRules> rules_;
  std::vector<CandidateView> candidates_;
  std::optional<Eigen::Vector3d> at_;  ///< place of the sensor
};

void ViewSearch::collect() {
  const auto points = field_.points();
  std::size_t directions = 1;
  for (const ToolSpec& tool : field_.tools()) {
    const int count = internal::resolvedFor(tool, params_).approach.directionCount();
    directions = std::max(directions, static_cast<std::size_t>(count));
  }
  const std::size_t most = std::clamp<std::size_t>(kMostOutcomes / directions, 64, kCounted);
  using Ordered = std::pair<std::uint64_t, Unresolved>;
  constexpr std::size_t kBlock = 4096;
  std::vector<std::vector<Ordered>> blocks((points->size() + kBlock - 1) / kBlock);
  tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t block) {
    for (std::size_t n = kBlock * block; n < std::min(kBlock * (block + 1), points->size()); ++n) {
      const SurfacePoint point = points->at(n);
      const bool open = point.reason == PointReason::Confidence || point.reason == PointReason::Unseen ||
                        point.reason == PointReason::Unknown;
      if (open) blocks[block].emplace_back(mixed(point.id), Unresolved{point.id, point.tool, point.reason});
    }
  });
  std::vector<Ordered> all;
  for (const std::vector<Ordered>& block : blocks) all.insert(all.end(), block.begin(), block.end());
  for (const auto& [order, one] : all) {
    ++(one.reason == PointReason::Confidence ? found_.confidence
       : one.reason == PointReason::Unseen   ? found_.unseen
                                             : found_.unknown);
  }
  if (all.empty()) {
    throw UnusableInput("views.none_missing", "", "no point lacks observations: what is blocked was seen to be",
                        "Scan what the map does not have yet, or see accessvdb approaches");
  }
  const std::size_t kept = std::min(most, all.size());
  const auto middle = all.begin() + static_cast<std::ptrdiff_t>(kept);
  const auto before = [](const Ordered& a, const Ordered& b) { return a.first < b.first; };
  std::nth_element(all.begin(), middle, all.end(), before);
  std::sort(all.begin(), middle, before);
  points_per_sample_ = static_cast<double>(all.size()) / static_cast<double>(kept);
  for (auto one = all.begin(); one != middle; ++one) sampled_.push_back(one->second);
}

/// Of the voxels that collide on the ways of returns to their sensor, each was passed; and each return ended at one.
void ViewSearch::measurePassing() {
  const internal::PointStore& points = internal::FieldAccess::points(field_);
  const KnownSpace::Reader reader(*space_);
  const std::size_t step = std::max<std::size_t>(1, points.size() / kWaysOfReturns);
  double passed = 0, ended = 0;
  for (std::size_t n = 0; n < points.size(); n += step) {
    const auto id = static_cast<std::uint32_t>(n);
    const Eigen::Vector3d place = points.first_L(id).cast<double>() / voxel_size_m_ + Eigen::Vector3d::Constant(0.5);
    const Eigen::Vector3d way = points.toSensor_L(id).cast<double>() / voxel_size_m_;
    const double end = way.norm() - rules_->same_surface;
    if (!(end > 0)) continue;
    passed += reader.collidingOn(place + way, -way.normalized(), {end, end, end}, 1 << 20)[0];
    ended += 1;
  }
  rules_->setPassing(passed / std::max(1.0, passed + ended));
}

/// What is missing at the points that were taken.
void ViewSearch::open() {
  std::map<std::size_t, std::vector<std::size_t>> of_tools;
  for (std::size_t n = 0; n < sampled_.size(); ++n) of_tools[sampled_[n].tool].push_back(n);
  points_.resize(sampled_.size());
  for (const auto& [tool, places] : of_tools) {
    std::vector<std::uint32_t> ids;
    for (const std::size_t n : places) ids.push_back(sampled_[n].id);
    const std::vector<AccessMap> maps = field_.accessMaps(ids, tool);
    tbb::parallel_for(std::size_t{0}, places.size(),
                      [&](std::size_t k) { points_[places[k]] = openPoint(maps[k], sampled_[places[k]].reason); });
  }
}

OpenPoint ViewSearch::openPoint(const AccessMap& map, PointReason reason) const {
  const KnownSpace::Reader reader(*space_);
  const ScoringParams& scoring = params_.scoring;
  OpenPoint point;
  point.place = placeOf(map.point.position_W);
  point.normal = map.point.normal_W;
  point.reason = reason;
  const double enough = scoring.confidence_half_weight * scoring.confidence_min / (1 - scoring.confidence_min);
  point.missing_weight = std::max(0.0, std::ceil(enough) - static_cast<double>(map.point.weight));
  std::vector<OpenWay> ways;
  for (const DirectionOutcome& outcome : map.directions) {
    if (outcome.reason == PointReason::Normal || outcome.reason == PointReason::Arm) continue;
    OpenWay way = {outcome.direction_W, 0, outcome.reason != PointReason::Unseen};
    bool obstructed = false;
    for (std::size_t k = 0; k < rules_->corridor.size(); ++k) {
      const Eigen::Vector3d sample = point.place + rules_->corridor[k] * way.along.cast<double>();
      const auto ijk = openvdb::Coord::floor(openvdb::Vec3d(sample.x(), sample.y(), sample.z()));
      obstructed = obstructed || reader.collides(ijk);
      if (!reader.isKnown(ijk)) way.unknown |= std::uint32_t{1} << k;
    }
    if (!obstructed) ways.push_back(way);
  }
  // It lacks no observation: it waits for its turn, or what it depends on was left out.
  const bool is_complete = point.missing_weight == 0 &&
                           std::ranges::any_of(ways, [](const OpenWay& way) { return way.seen && way.unknown == 0; });
  if (is_complete) point.left = 0;
  const std::size_t step = std::max<std::size_t>(1, (ways.size() + OpenPoint::kMostWays - 1) / OpenPoint::kMostWays);
  for (std::size_t n = 0; n < ways.size(); n += step) point.ways.push_back(ways[n]);
  return point;
}

void ViewSearch::findCandidates() {
  const double level_density = rules_->density(0);
  const double farthest = std::min(rules_->max_range, std::sqrt(level_density / kLeastReturns));
  const std::optional<Eigen::Vector3d> from = options_.from_W ? std::optional(placeOf(*options_.from_W)) : std::nullopt;
  at_ = from;
  const double within = options_.within_m / voxel_size_m_;
  std::vector<const openvdb::BoolTree::LeafNodeType*> leaves;
  space_->tree().getNodes(leaves);
  struct FreeLeaf {
    openvdb::Coord origin;
    openvdb::Index free;  ///< voxels
    std::uint64_t order;
  };
  // Of a ball around a place in a leaf, an eighth lies on the leaf's side of all three axes, as far as that goes.
  const double radius = options_.body_radius_m / voxel_size_m_;
  const auto least_free = static_cast<openvdb::Index>(std::clamp(M_PI / 12 * radius * radius * radius, 1.0, 108.0));
  std::vector<FreeLeaf> free;
  for (const auto* leaf : leaves) {
    const openvdb::Coord& origin = leaf->origin();
    const Eigen::Vector3d middle(origin[0] + 4, origin[1] + 4, origin[2] + 4);
    if (from && (middle - *from).norm() > within + 4 * std::sqrt(3.0)) continue;
    if (const openvdb::Index count = internal::freeVoxels(*leaf); count >= least_free)
      free.push_back({origin, count, mixed(origin)});
  }
  // Cells grow until there are few enough.
  std::size_t shift = 3;
  const auto cellOf = [&](const FreeLeaf& leaf) { return leaf.origin >> shift; };
  const auto countCells = [&] {
    std::vector<openvdb::Coord> cells;
    for (const FreeLeaf& leaf : free) cells.push_back(cellOf(leaf));
    std::sort(cells.begin(), cells.end());
    return std::unique(cells.begin(), cells.end()) - cells.begin();
  };
  while (countCells() > static_cast<std::ptrdiff_t>(kMostCells)) ++shift;
  std::map<openvdb::Coord, std::vector<FreeLeaf>> cells;
  for (const FreeLeaf& leaf : free) cells[cellOf(leaf)].push_back(leaf);
  std::vector<std::vector<FreeLeaf>> lists;
  for (auto& [cell, of_cell] : cells) lists.push_back(std::move(of_cell));
  std::vector<std::optional<Eigen::Vector3d>> fits(lists.size());
  tbb::parallel_for(std::size_t{0}, lists.size(), [&](std::size_t n) {
    // Where most is known to be free, the body is most likely to be.
    std::sort(lists[n].begin(), lists[n].end(),
              [](const auto& a, const auto& b) { return a.free != b.free ? a.free > b.free : a.order < b.order; });
    const KnownSpace::Reader reader(*space_);
    for (std::size_t k = 0; k < std::min(lists[n].size(), kTriedInCell) && !fits[n]; ++k) {
      for (int corner = 0; corner < 8 && !fits[n]; ++corner) {
        const openvdb::Coord& origin = lists[n][k].origin;
        const auto at = [&](int axis) { return origin[axis] + ((corner >> axis & 1) == 0 ? 2 : 6); };
        const Eigen::Vector3d place(at(0), at(1), at(2));
        if (from && (place - *from).norm() > within) continue;
        if (reader.ballIsFree(place, radius)) fits[n] = place;
      }
    }
  });
  if (std::ranges::none_of(fits, [](const auto& place) { return place.has_value(); })) {
    throw UnusableInput("views.no_free_space", "",
                        "nowhere is a ball of " + std::to_string(options_.body_radius_m) + " m known to be free",
                        "Map with clear_rays_m and platform_radius_m, or use a smaller body");
  }
  for (const auto& place : fits) {
    if (!place) continue;
    const bool near =
        std::ranges::any_of(points_, [&](const OpenPoint& p) { return (p.place - *place).norm() < farthest; });
    if (near) addPoses(*place);
  }
}

void ViewSearch::addPoses(const Eigen::Vector3d& place) {
  const double width = options_.sensor.azimuth_rad;
  const bool all_around = width > 2 * std::numbers::pi - 1e-6;
  for (const double pitch : options_.sensor.pitches_rad) {
    const int headings =
        all_around && pitch == 0 ? 1 : std::max(kHeadings, static_cast<int>(std::ceil(4 * std::numbers::pi / width)));
    for (int n = 0; n < headings; ++n)
      candidates_.push_back({{place, heldAt(2 * std::numbers::pi * n / headings, pitch)}});
  }
}

double ViewSearch::gainOf(const SensorPose& pose) const {
  const ViewGain gain(*space_, *rules_);
  double sum = 0;
  for (std::size_t n = 0; n < compared_; ++n) {
    if (points_[n].left > 0.02) sum += points_[n].left * gain.of(pose, points_[n]);
  }
  return sum;
}

double ViewSearch::worthOf(const CandidateView& candidate) const {
  if (!at_) return candidate.gain;
  return candidate.gain / (1 + (candidate.pose.place - *at_).norm() * voxel_size_m_ / options_.travel_m);
}

/// The best first, each with what those before it have left. What a view brings hardly ever grows by an earlier one, so
/// only those are computed again that would be best.
void ViewSearch::choose() {
  compared_ = std::min(kCompared, points_.size());
  found_.tried = candidates_.size();
  tbb::parallel_for(std::size_t{0}, candidates_.size(),
                    [&](std::size_t n) { candidates_[n].gain = gainOf(candidates_[n].pose); });
  for (std::size_t round = 0; round < options_.most && !candidates_.empty(); ++round) {
    CandidateView* best = nullptr;
    for (;;) {
      best = &*std::ranges::max_element(candidates_, {}, [&](const CandidateView& one) { return worthOf(one); });
      if (best->round == round || best->gain <= 0) break;
      best->gain = gainOf(best->pose);
      best->round = round;
    }
    const double points =
        best->gain * points_per_sample_ * static_cast<double>(points_.size()) / static_cast<double>(compared_);
    if (!(points > kFewestPoints)) break;
    add(*best);
  }
}

void ViewSearch::add(const CandidateView& chosen) {
  NextView view;
  std::vector<double> resolved(points_.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points_.size(), 64), [&](const auto& range) {
    const ViewGain gain(*space_, *rules_);
    for (std::size_t n = range.begin(); n < range.end(); ++n) {
      const double before = points_[n].left;
      if (before > 0) gain.take(chosen.pose, points_[n]);
      resolved[n] = before - points_[n].left;
    }
  });
  Eigen::Vector3d middle = {0, 0, 0};
  for (std::size_t n = 0; n < points_.size(); ++n) {
    const double count = resolved[n] * points_per_sample_;
    view.resolves += count;
    middle += count * points_[n].place;
    const PointReason reason = points_[n].reason;
    double& of_reason = reason == PointReason::Confidence ? view.of_confidence
                        : reason == PointReason::Unseen   ? view.of_unseen
                                                          : view.of_unknown;
    of_reason += count;
  }
  view.T_W_S.translation() = positionOf(chosen.pose.place);
  view.T_W_S.linear() = chosen.pose.R_WS;
  const double width = options_.sensor.azimuth_rad;
  if (width > 2 * std::numbers::pi - 1e-6 && chosen.pose.R_WS.isIdentity() && view.resolves > 0) {
    // All headings are alike: look to where most of it is.
    const Eigen::Vector3d towards = middle / view.resolves - chosen.pose.place;
    view.T_W_S.linear() = heldAt(std::atan2(towards.y(), towards.x()), 0);
  }
  if (at_) {
    const Eigen::Vector3d from_W = positionOf(*at_);
    view.travel_m = (view.T_W_S.translation() - from_W).norm();
    const CapsuleQuery way = {from_W, view.T_W_S.translation(), options_.body_radius_m};
    view.way_is_free = field_.batchQuery().along({&way, 1})[0].free();
  }
  char words[160];
  std::snprintf(
      words, sizeof words,
      "resolves about %.0f points: %.0f seen too rarely, %.0f from the wrong side, %.0f with unknown space before them",
      view.resolves, view.of_confidence, view.of_unseen, view.of_unknown);
  view.why = words;
  at_ = chosen.pose.place;
  found_.views.push_back(std::move(view));
}

}  // namespace

NextViews nextViews(const AccessibilityField& field, const ViewOptions& options) {
  return ViewSearch(field, options).run();
}

}  // namespace accessvdb
