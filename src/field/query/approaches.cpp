// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/approaches.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <span>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/pose_query.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tool_spec.h"
#include "field/query/free_arcs.h"
#include "field/tools/tools_of_field.h"

namespace accessvdb {
namespace {

/// Points whose ways are tried together.
constexpr std::size_t kTriedAtOnce = 512;
/// Points without a way within the spacing, until no more are tried there.
constexpr std::size_t kTriedAround = 8;
/// Two approaches of a target differ by more than this.
constexpr double kOtherWay_cos = 0.8660254037844387;  // 30 degrees
constexpr double kArcStep_deg = 10, kConfidenceStep = 0.1, kLengthStep_m = 0.5;

double stepsOf(double value, double step) { return std::floor(value / step + 1e-9); }

/// Places that lie in cubes of an edge: what is within the edge of a place is in the 27 cubes around it.
class PlaceGrid {
 public:
  explicit PlaceGrid(double edge_m) : edge_m_(edge_m) {}
  void add(const Eigen::Vector3d& p, std::size_t number) { cells_[cellOf(p)].emplace_back(p, number); }
  template <typename Visit>
  void forEachWithin(const Eigen::Vector3d& p, const Visit& visit) const {
    const Cell at = cellOf(p);
    for (std::int64_t x = at[0] - 1; x <= at[0] + 1; ++x) {
      for (std::int64_t y = at[1] - 1; y <= at[1] + 1; ++y) {
        for (std::int64_t z = at[2] - 1; z <= at[2] + 1; ++z) {
          const auto found = cells_.find({x, y, z});
          if (found == cells_.end()) continue;
          for (const auto& [place, number] : found->second)
            if ((place - p).squaredNorm() < edge_m_ * edge_m_) visit(number);
        }
      }
    }
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  [[nodiscard]] Cell cellOf(const Eigen::Vector3d& p) const {
    Cell cell = {};
    for (std::size_t axis = 0; axis < 3; ++axis)
      cell[axis] = static_cast<std::int64_t>(std::floor(p[static_cast<Eigen::Index>(axis)] / edge_m_));
    return cell;
  }
  struct HashOfCell {
    std::size_t operator()(const Cell& cell) const {
      std::uint64_t hash = 0;
      for (const std::int64_t at : cell) hash = (hash ^ static_cast<std::uint64_t>(at)) * 0x9E3779B97F4A7C15U;
      return hash ^ hash >> 32;
    }
  };
  double edge_m_;
  std::unordered_map<Cell, std::vector<std::pair<Eigen::Vector3d, std::size_t>>, HashOfCell> cells_;
};

/// Poses of a tool on its way back from contact.
class WayBack {
 public:
  WayBack(const AccessibilityField& field, const ApproachOptions& options, double stand_off_m)
      : query_(field.poseQuery()), allow_unknown_(options.allow_unknown), stand_off_m_(stand_off_m) {
    const double v = field.params().tsdf.voxel_size_m;
    nearest_m_ = std::min(query_.contactWay_m(), stand_off_m);
    for (double back_m = nearest_m_; back_m < 2 * stand_off_m; back_m += v) back_m_.push_back(back_m);
    back_m_.push_back(stand_off_m);
    back_m_.push_back(2 * stand_off_m);
    std::sort(back_m_.begin(), back_m_.end());
  }

  /// How far back each way is free; less than the stand-off: it is none.
  [[nodiscard]] std::vector<double> freeFor_m(const std::vector<Eigen::Isometry3d>& contact_T_WT,
                                              std::size_t tool) const {
    std::vector<double> free_m;
    for (std::size_t begin = 0; begin < contact_T_WT.size(); begin += kTriedAtOnce) {
      const std::span<const Eigen::Isometry3d> all(contact_T_WT);
      addFreeFor_m(all.subspan(begin, std::min(kTriedAtOnce, all.size() - begin)), tool, free_m);
    }
    return free_m;
  }
  [[nodiscard]] bool isWay(double free_m) const { return free_m >= stand_off_m_; }
  /// Nearer than that, as where the field scores a point: nothing collides on the way to contact but what it touches.
  [[nodiscard]] std::vector<bool> reachesContact(const std::vector<Eigen::Isometry3d>& contact_T_WT,
                                                 std::size_t tool) const {
    std::vector<bool> reaches;
    for (const FitAnswer& answer : query_.fitsIntoContact(contact_T_WT, tool)) reaches.push_back(!answer.collision());
    return reaches;
  }
  [[nodiscard]] ApproachPath pathOf(const Eigen::Isometry3d& contact_T_WT, double free_m) const {
    ApproachPath path;
    path.contact_T_WT = contact_T_WT;
    path.pre_contact_T_WT = backBy(contact_T_WT, stand_off_m_);
    path.retreat_T_WT = backBy(contact_T_WT, free_m);
    path.seen_free_m = free_m;
    return path;
  }

 private:
  void addFreeFor_m(std::span<const Eigen::Isometry3d> contact_T_WT, std::size_t tool,
                    std::vector<double>& free_m) const {
    std::vector<Eigen::Isometry3d> poses;
    for (const Eigen::Isometry3d& T_WT : contact_T_WT)
      for (const double back_m : back_m_) poses.push_back(backBy(T_WT, back_m));
    FitOptions options;
    options.tool = tool;
    const std::vector<FitAnswer> answers = query_.fits(poses, options);
    for (std::size_t n = 0; n < contact_T_WT.size(); ++n) {
      double free_for_m = 0;
      for (std::size_t k = 0; k < back_m_.size(); ++k) {
        const FitAnswer& answer = answers[n * back_m_.size() + k];
        if (answer.collision() || (answer.unknown() && !allow_unknown_)) break;
        free_for_m = back_m_[k];
      }
      free_m.push_back(free_for_m);
    }
  }
  static Eigen::Isometry3d backBy(const Eigen::Isometry3d& T_WT, double back_m) {
    Eigen::Isometry3d moved = T_WT;
    moved.translation() += back_m * T_WT.linear().col(0);
    return moved;
  }

  PoseQuery query_;
  bool allow_unknown_;
  double stand_off_m_, nearest_m_ = 0;
  std::vector<double> back_m_;
};

Eigen::Isometry3d contactPose(const Eigen::Vector3d& p_W, const Eigen::Quaternionf& q_WT) {
  Eigen::Isometry3d T_WT = Eigen::Isometry3d::Identity();
  T_WT.linear() = q_WT.cast<double>().normalized().toRotationMatrix();
  T_WT.translation() = p_W;
  return T_WT;
}

struct Candidate {
  SurfacePoint point;  ///< with a direction of the tool below
  /// The tool with the largest margin that reaches the point: itself, or the one that stands for the point, grown.
  std::size_t with_room = 0;
  std::int32_t value = 0;  ///< of `per`
  double distance_m = 0;
  float free_arc_deg = -1;
  double free_m = 0;
  bool is_free = false;  ///< there is a direction
};

std::vector<bool> freeOf(const AccessMap& map) {
  std::vector<bool> free;
  for (const DirectionOutcome& outcome : map.directions) free.push_back(outcome.reason == PointReason::None);
  return free;
}

/// The free directions: those from which the tool can turn farthest to either side first, then those with the least
/// score, then by index.
std::vector<std::uint16_t> deepestFirst(const AccessMap& map, const std::vector<std::size_t>& depths) {
  std::vector<std::uint16_t> order;
  for (std::size_t d = 0; d < depths.size(); ++d)
    if (map.directions[d].reason == PointReason::None) order.push_back(static_cast<std::uint16_t>(d));
  std::stable_sort(order.begin(), order.end(), [&](std::uint16_t a, std::uint16_t b) {
    if (depths[a] != depths[b]) return depths[a] > depths[b];
    return map.directions[a].score < map.directions[b].score;
  });
  return order;
}

std::string wordsOf(const Candidate& candidate, const ApproachOptions& options) {
  char text[160];
  std::string words;
  const auto add = [&](const char* format, double value) {
    std::snprintf(text, sizeof text, format, value);
    words.append(words.empty() ? "" : ", ").append(text);
  };
  if (candidate.point.margin_m >= 0) add("%.3g m of room", static_cast<double>(candidate.point.margin_m));
  if (candidate.free_arc_deg >= 0) add("turns by %.0f degrees", static_cast<double>(candidate.free_arc_deg));
  add("confidence %.2f", static_cast<double>(candidate.point.confidence));
  if (options.from_W) add("%.2f m away", candidate.distance_m);
  add(options.allow_unknown ? "way of %.2f m without a known obstacle" : "way of %.2f m seen free", candidate.free_m);
  return words;
}

class Search {
 public:
  Search(const AccessibilityField& field, const ApproachOptions& given) : field_(field), options_(given) {
    const double v = field.params().tsdf.voxel_size_m;
    if (options_.spacing_m == 0) options_.spacing_m = std::max(0.25, 5 * v);
    if (options_.stand_off_m == 0) options_.stand_off_m = std::max(0.3, 8 * v);
    const auto require = [](bool fine, const char* option, const char* words) {
      if (!fine) throw InvalidArgument("approaches.options", option, words, "Leave it out for the rule");
    };
    require(options_.spacing_m >= v && options_.spacing_m <= 1e6, "spacing_m", "is not a voxel or more");
    require(options_.stand_off_m >= v && options_.stand_off_m <= 1e3, "stand_off_m", "is not a voxel or more");
    require(options_.each >= 1, "ApproachOptions::each", "is 0");
    require(options_.within_m >= 0, "within_m", "is not a distance");
    require(!options_.from_W || options_.from_W->allFinite(), "from_W", "is not finite");
    if (std::isfinite(options_.within_m) && !options_.from_W) {
      throw InvalidArgument("approaches.options", "within_m", "says how far, and from_W does not say from where",
                            "Give both");
    }
  }

  [[nodiscard]] Approaches run() {
    collect();
    const WayBack way(field_, options_, options_.stand_off_m);
    std::vector<Candidate> targets = spread(way);
    found_.covered = cover(targets);
    rank(targets);
    if (options_.most > 0) keepMost(targets);
    addWays(targets, way);
    return std::move(found_);
  }

 private:
  void collect();
  void findRoom();
  void chooseDirections(std::span<const std::size_t> turn);
  static void choose(Candidate& candidate, const AccessMap& map, const internal::DirectionNeighbours& neighbours);
  [[nodiscard]] PlaceGrid& gridOf(std::map<std::int32_t, PlaceGrid>& grids, const Candidate& candidate) const {
    return grids.try_emplace(candidate.value, options_.spacing_m).first->second;
  }
  [[nodiscard]] std::vector<Candidate> spread(const WayBack& way);
  [[nodiscard]] std::uint64_t cover(const std::vector<Candidate>& targets);
  void rank(std::vector<Candidate>& targets) const;
  void keepMost(std::vector<Candidate>& targets) const;
  void addWays(const std::vector<Candidate>& targets, const WayBack& way);
  void addOtherWays(ApproachTarget& target, const AccessMap& map, const WayBack& way);
  /// Made once: over a sphere it takes the square of the directions.
  const internal::DirectionNeighbours& neighboursOf(std::size_t tool) {
    const auto found = neighbours_.find(tool);
    if (found != neighbours_.end()) return found->second;
    const ApproachParams approach = internal::resolvedFor(field_.tools()[tool], field_.params()).approach;
    return neighbours_.emplace(tool, internal::DirectionNeighbours(approach)).first->second;
  }

  const AccessibilityField& field_;
  ApproachOptions options_;
  Approaches found_;
  std::vector<Candidate> all_;
  std::map<std::size_t, internal::DirectionNeighbours> neighbours_;  ///< by tool
  std::map<std::uint32_t, std::size_t> covers_;                      ///< by the target's point
};

void Search::collect() {
  const auto points = field_.points();
  std::optional<std::size_t> column;
  if (!options_.per.empty()) {
    const std::vector<std::string> names = points->attributeNames();
    const auto found = std::find(names.begin(), names.end(), options_.per);
    if (found == names.end()) {
      throw InvalidArgument("approaches.per", options_.per, "is nothing that the scans carried",
                            "Name one that it was made with: FieldParams::carry");
    }
    column = static_cast<std::size_t>(found - names.begin());
  }
  for (std::size_t n = 0; n < points->size(); ++n) {
    Candidate candidate = {points->at(n)};
    if (candidate.point.label != PointLabel::Accessible) continue;
    if (options_.from_W) candidate.distance_m = (candidate.point.position_W - *options_.from_W).norm();
    if (!(candidate.distance_m <= options_.within_m)) continue;
    if (column) candidate.value = points->attribute(n, *column);
    all_.push_back(std::move(candidate));
  }
  findRoom();
  if (all_.empty()) {
    throw UnusableInput("approaches.none", "", "no point is accessible that is near enough",
                        "See the reasons of its points, and what their access maps say");
  }
  found_.accessible = all_.size();
  // What decides which point stands for those around it; that of a target's place among others comes later.
  std::sort(all_.begin(), all_.end(), [](const Candidate& a, const Candidate& b) {
    return std::tuple(-a.point.margin_m, -stepsOf(a.point.confidence, kConfidenceStep), a.point.score, a.point.id) <
           std::tuple(-b.point.margin_m, -stepsOf(b.point.confidence, kConfidenceStep), b.point.score, b.point.id);
  });
}

/// A point's margin is that of some direction, which need not be free for the tool that stands for it, without room.
void Search::findRoom() {
  const std::vector<ToolSpec>& tools = field_.tools();
  for (Candidate& candidate : all_) {
    candidate.with_room = candidate.point.tool;
    for (std::size_t k = candidate.point.tool + std::size_t{1}; k < tools.size() && tools[k].tool.margin_m() > 0; ++k)
      if ((candidate.point.tools >> k & 1) != 0) candidate.with_room = k;
  }
}

/// Of the free directions with the room that there is, one from which the tool can turn far to either side.
void Search::chooseDirections(std::span<const std::size_t> turn) {
  std::map<std::size_t, std::vector<std::size_t>> of_tools;
  for (const std::size_t n : turn) of_tools[all_[n].with_room].push_back(n);
  for (const auto& [tool, places] : of_tools) {
    const internal::DirectionNeighbours& neighbours = neighboursOf(tool);
    for (std::size_t begin = 0; begin < places.size(); begin += kTriedAtOnce) {
      std::vector<std::uint32_t> ids;
      const std::size_t end = std::min(begin + kTriedAtOnce, places.size());
      for (std::size_t k = begin; k < end; ++k) ids.push_back(all_[places[k]].point.id);
      const std::vector<AccessMap> maps = field_.accessMaps(ids, tool);
      for (std::size_t k = begin; k < end; ++k) choose(all_[places[k]], maps[k - begin], neighbours);
    }
  }
}

void Search::choose(Candidate& candidate, const AccessMap& map, const internal::DirectionNeighbours& neighbours) {
  const std::vector<bool> free = freeOf(map);
  const std::vector<std::uint16_t> order = deepestFirst(map, internal::freeDepths(neighbours, free));
  candidate.is_free = !order.empty();
  if (!candidate.is_free) return;
  const std::uint16_t d = order.front();
  candidate.point.direction = d;
  candidate.point.roll = map.directions[d].roll;
  candidate.point.score = map.directions[d].score;
  candidate.point.orientation_WT = map.directions[d].orientation_WT;
  candidate.free_arc_deg = internal::freeArc_deg(neighbours, free, d);
}

/// In turns: of the points that are not within the spacing of a target, as many as keep the spacing among themselves,
/// the best first. Those that have a way are targets; of the points around those that have none, a few more are tried.
std::vector<Candidate> Search::spread(const WayBack& way) {
  std::vector<Candidate> targets;
  using Grids = std::map<std::int32_t, PlaceGrid>;  // with `per`, each value has its own
  Grids taken, in_vain;
  const auto around = [&](Grids& grids, const Candidate& candidate) {
    std::size_t count = 0;
    gridOf(grids, candidate).forEachWithin(candidate.point.position_W, [&](std::size_t) { ++count; });
    return count;
  };
  std::vector<std::size_t> left(all_.size());
  for (std::size_t n = 0; n < left.size(); ++n) left[n] = n;
  while (!left.empty()) {
    Grids of_turn;
    std::vector<std::size_t> turn, later;
    for (const std::size_t n : left) {
      if (around(taken, all_[n]) > 0 || around(in_vain, all_[n]) >= kTriedAround) continue;
      if (around(of_turn, all_[n]) > 0) {
        later.push_back(n);
        continue;
      }
      gridOf(of_turn, all_[n]).add(all_[n].point.position_W, n);
      turn.push_back(n);
    }
    chooseDirections(turn);
    for (std::size_t tool = 0; tool < field_.tools().size(); ++tool) {
      std::vector<std::size_t> of_tool;
      std::vector<Eigen::Isometry3d> poses;
      for (const std::size_t n : turn) {
        if (all_[n].point.tool != tool) continue;
        of_tool.push_back(n);
        poses.push_back(contactPose(all_[n].point.position_W, all_[n].point.orientation_WT));
      }
      if (poses.empty()) continue;
      const std::vector<double> free_m = way.freeFor_m(poses, tool);
      std::vector<Eigen::Isometry3d> with_way;
      for (std::size_t k = 0; k < of_tool.size(); ++k)
        if (way.isWay(free_m[k])) with_way.push_back(poses[k]);
      const std::vector<bool> reaches = way.reachesContact(with_way, tool);
      std::size_t next = 0;
      for (std::size_t k = 0; k < of_tool.size(); ++k) {
        Candidate& candidate = all_[of_tool[k]];
        candidate.free_m = candidate.is_free ? free_m[k] : 0;
        if (!way.isWay(free_m[k]) || !reaches[next++]) {
          ++found_.without_way;
          gridOf(in_vain, candidate).add(candidate.point.position_W, of_tool[k]);
          continue;
        }
        gridOf(taken, candidate).add(candidate.point.position_W, of_tool[k]);
        targets.push_back(candidate);
      }
    }
    left = std::move(later);
  }
  return targets;
}

std::uint64_t Search::cover(const std::vector<Candidate>& targets) {
  PlaceGrid grid(options_.spacing_m);
  for (const Candidate& target : targets) grid.add(target.point.position_W, target.point.id);
  std::uint64_t covered = 0;
  for (const Candidate& candidate : all_) {
    bool near = false;
    grid.forEachWithin(candidate.point.position_W, [&](std::size_t id) {
      near = true;
      ++covers_[static_cast<std::uint32_t>(id)];
    });
    covered += near ? 1 : 0;
  }
  return covered;
}

void Search::rank(std::vector<Candidate>& targets) const {
  const auto key = [this](const Candidate& c) {
    const double arc = c.free_arc_deg, confidence = c.point.confidence;
    return std::tuple(c.value, -c.point.margin_m, -stepsOf(arc, kArcStep_deg), -stepsOf(confidence, kConfidenceStep),
                      options_.from_W ? stepsOf(c.distance_m, kLengthStep_m) : 0.0,
                      -stepsOf(c.point.position_W.z(), kLengthStep_m), c.point.id);
  };
  std::sort(targets.begin(), targets.end(), [&](const Candidate& a, const Candidate& b) { return key(a) < key(b); });
}

void Search::keepMost(std::vector<Candidate>& targets) const {
  std::map<std::int32_t, std::size_t> kept;
  std::erase_if(targets, [&](const Candidate& target) { return ++kept[target.value] > options_.most; });
}

void Search::addWays(const std::vector<Candidate>& targets, const WayBack& way) {
  std::map<std::size_t, std::vector<std::uint32_t>> ids;
  std::map<std::pair<std::size_t, std::uint32_t>, std::size_t> target_of;
  for (const Candidate& candidate : targets) {
    ApproachTarget target;
    target.point = candidate.point.id;
    target.position_W = candidate.point.position_W;
    target.normal_W = candidate.point.normal_W;
    target.tool = candidate.point.tool;
    target.margin_m = candidate.point.margin_m;
    target.confidence = candidate.point.confidence;
    target.access_probability = candidate.point.access_probability;
    target.distance_m = candidate.distance_m;
    target.covers = covers_[candidate.point.id];
    target.value = candidate.value;
    target.why = wordsOf(candidate, options_);
    ApproachPath path =
        way.pathOf(contactPose(candidate.point.position_W, candidate.point.orientation_WT), candidate.free_m);
    path.direction = candidate.point.direction;
    path.roll = candidate.point.roll;
    path.collisions = candidate.point.score;
    path.free_arc_deg = candidate.free_arc_deg;
    target.approaches.push_back(path);
    found_.targets.push_back(std::move(target));
    ids[candidate.with_room].push_back(candidate.point.id);
    target_of[{candidate.with_room, candidate.point.id}] = found_.targets.size() - 1;
  }
  if (options_.each == 1) return;
  for (const auto& [tool, list] : ids) {
    for (std::size_t begin = 0; begin < list.size(); begin += kTriedAtOnce) {
      const std::span<const std::uint32_t> some(list.data() + begin, std::min(kTriedAtOnce, list.size() - begin));
      for (const AccessMap& map : field_.accessMaps(some, tool))
        addOtherWays(found_.targets[target_of[{tool, map.point.id}]], map, way);
    }
  }
}

void Search::addOtherWays(ApproachTarget& target, const AccessMap& map, const WayBack& way) {
  const std::vector<bool> free = freeOf(map);
  const internal::DirectionNeighbours& neighbours = neighboursOf(target.tool);
  const std::vector<std::uint16_t> order = deepestFirst(map, internal::freeDepths(neighbours, free));
  std::vector<Eigen::Isometry3d> poses;
  for (const std::uint16_t d : order) poses.push_back(contactPose(target.position_W, map.directions[d].orientation_WT));
  if (poses.empty()) return;
  const std::vector<double> free_m = way.freeFor_m(poses, target.tool);
  for (std::size_t k = 0; k < order.size() && target.approaches.size() < options_.each; ++k) {
    const Eigen::Vector3d axis_W = poses[k].linear().col(0);
    const bool alike = std::ranges::any_of(target.approaches, [&](const ApproachPath& path) {
      return path.contact_T_WT.linear().col(0).dot(axis_W) > kOtherWay_cos;
    });
    if (alike || !way.isWay(free_m[k]) || !way.reachesContact({poses[k]}, target.tool)[0]) continue;
    ApproachPath path = way.pathOf(poses[k], free_m[k]);
    path.direction = order[k];
    path.roll = map.directions[order[k]].roll;
    path.collisions = map.directions[order[k]].score;
    path.free_arc_deg = internal::freeArc_deg(neighbours, free, order[k]);
    target.approaches.push_back(path);
  }
}

}  // namespace

Approaches approaches(const AccessibilityField& field, const ApproachOptions& options) {
  return Search(field, options).run();
}

}  // namespace accessvdb
