// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The rules behind parameters left at 0, and their checks (docs/PAPER_MAP.md).
#include "accessvdb/params.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <type_traits>

#include "accessvdb/error.h"
#include "accessvdb/params_rows.h"
#include "field/carry.h"
#include "field/thread_count.h"

namespace accessvdb {
namespace {

constexpr std::int32_t kMostWindow_voxels = 1 << 20;

/// A field of any type, to count the fields of a struct.
struct AnyField {
  template <typename Field>
  operator Field() const;
};
template <typename Struct, typename... Fields>
consteval std::size_t fieldCount() {
  if constexpr (requires { Struct{Fields{}..., AnyField{}}; }) {
    return fieldCount<Struct, Fields..., AnyField>();
  } else {
    return sizeof...(Fields);
  }
}
template <ParamStruct Params>
constexpr bool kHasAllRows = std::tuple_size_v<decltype(kParamRows<Params>)> == fieldCount<Params>();
static_assert(kHasAllRows<ProjectiveParams>, "a field of params.h has no row in params_rows.h");
static_assert(kHasAllRows<TsdfParams>, "a field of params.h has no row in params_rows.h");
static_assert(kHasAllRows<ApproachParams>, "a field of params.h has no row in params_rows.h");
static_assert(kHasAllRows<ScoringParams>, "a field of params.h has no row in params_rows.h");
static_assert(kHasAllRows<UpdateParams>, "a field of params.h has no row in params_rows.h");
static_assert(kHasAllRows<ChangeParams>, "a field of params.h has no row in params_rows.h");
static_assert(kHasAllRows<FieldParams>, "a field of params.h has no row in params_rows.h");

template <typename Value>
std::string text(const Value& value) {
  if constexpr (std::is_same_v<Value, bool>) {
    return value ? "true" : "false";
  } else if constexpr (std::is_enum_v<Value>) {
    // resolved() does not ask whether the number of an enum is one of its values.
    return kEnumWords<Value>[std::min(static_cast<std::size_t>(value), kEnumWords<Value>.size() - 1)];
  } else if constexpr (std::is_same_v<Value, std::array<double, 3>>) {
    return text(value[0]) + " " + text(value[1]) + " " + text(value[2]);
  } else {
    char buffer[32];
    const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
    return {buffer, end};
  }
}

/// @throws InvalidArgument unless value is in [low, high]; NaN never is.
void require(const char* field, double value, double low, double high, const char* advice = "") {
  if (value >= low && value <= high) return;
  const auto digits = [](double number) {  // those of a count of bytes, too
    const bool whole = std::abs(number) < 1e12 && number == std::trunc(number);
    return whole ? text(static_cast<std::int64_t>(number)) : text(number);
  };
  throw InvalidArgument("config.range", field, digits(value) + " is outside " + digits(low) + " .. " + digits(high),
                        advice);
}

/// PCA neighbours: noise comparable to the voxel needs more of them.
int neighboursFor(double range_noise_m, double voxel_size_m) {
  if (range_noise_m >= 2 * voxel_size_m) return 100;
  if (range_noise_m >= voxel_size_m) return 60;
  return range_noise_m >= 0.5 * voxel_size_m ? 30 : 10;
}

/// What a scan of 30 m may reach again: each halving of the voxels makes it about five times as much.
std::uint64_t deviceCacheFor(double voxel_size_m) {
  constexpr double kCoarse_m = 0.01, kLeast_bytes = 4e9, kMost_bytes = 64e9;
  constexpr double kRounding = 1e-6;  // 10 mm may have been a float
  const double halvings = std::max(0.0, std::ceil(std::log2(kCoarse_m / voxel_size_m) - kRounding));
  return static_cast<std::uint64_t>(std::min(kMost_bytes, kLeast_bytes * std::pow(5.0, halvings)));
}

/// Checks a value, or each value of an array, against the range of its row.
template <typename Row, typename Value>
void requireRange(const Row& row, const Value& value, const FieldParams& all, const std::string& prefix = "") {
  if constexpr (std::is_same_v<Value, std::optional<std::array<double, 3>>>) {
    if (value) requireRange(row, *value, all, prefix);
  } else if constexpr (std::is_same_v<Value, std::array<double, 3>>) {
    for (const double number : value) requireRange(row, number, all, prefix);
  } else {
    const ParamRange range = row.rangeIn(all);
    require((prefix + row.c_name).c_str(), static_cast<double>(value), range.low, range.high, range.advice);
  }
}

/// The same for some parameters of a struct, or for all that have a range, in order.
template <auto... kMembers, typename Params>
void requireRanges(const Params& params, const FieldParams& all, const std::string& prefix = "") {
  forEachRow<Params>([&]<typename Row>(const Row& row) {
    constexpr bool kAsked = sizeof...(kMembers) == 0 || (Row::template is<kMembers> || ...);
    if constexpr (kAsked && Row::has_range) requireRange(row, params.*Row::member, all, prefix);
  });
}

void requireProjective(const FieldParams& all) {
  const ProjectiveParams& p = all.tsdf.projective;
  const double voxel_size_m = all.tsdf.voxel_size_m;
  requireRanges(p, all, "projective.");
  if (!p.in_front && !p.empty_is_free) return;
  constexpr double kMostLeaves = 1 << 22;  // 8 GiB of voxels
  double leaves = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    require("projective.box_min_W_m", p.box_min_W_m[axis], -1e8, 1e8);
    require("projective.box_max_W_m", p.box_max_W_m[axis], p.box_min_W_m[axis] + voxel_size_m, 1e8,
            "Set the box around the scene that in_front and empty_is_free may update");
    leaves *= (p.box_max_W_m[axis] - p.box_min_W_m[axis]) / (8 * voxel_size_m) + 2;
  }
  require("projective box, in leaves", leaves, 0, kMostLeaves, "Choose a smaller box or a larger voxel");
}

/// What the paper's policy cannot do, whose directions are a window around a yaw, and whose scores are kept.
void requireOrientations(const FieldParams& p) {
  static_cast<void>(p.approach.directionCount());  // throws for a set that is none
  const bool paper = p.update.policy == UpdatePolicy::Paper || p.approach.coarse_to_fine || p.approach.viewpoints;
  if (paper && !p.approach.orientations.isYaw()) {
    throw InvalidArgument("orientations.policy", "orientations " + p.approach.orientations.text(),
                          "the paper's policy, its coarse pass and its viewpoints support only yaw directions",
                          "Use the exact policy and the product profile, or orientations yaw");
  }
  if (paper && p.approach.rolls > 1) {
    throw InvalidArgument("orientations.policy", "rolls " + std::to_string(p.approach.rolls),
                          "the paper's policy, its coarse pass and its viewpoints do not support rolls",
                          "Use the exact policy and the product profile, or rolls 1");
  }
}

void requireChange(const FieldParams& p) {
  requireRanges(p.change, p);
  if (std::isfinite(p.change.free_for_s) && p.change.mode != ChangeMode::Full) {
    throw InvalidArgument("config.change", "free_for_s", "is finite, which needs ChangeMode::Full",
                          "Use ChangeMode::Full, or leave free_for_s at infinity");
  }
}

/// What cannot leave points out. @param p  with a spacing
void requireSpacing(const FieldParams& p) {
  const auto refuse = [](const std::string& subject, const std::string& problem, const std::string& advice) {
    throw InvalidArgument("config.points", subject, problem, advice);
  };
  if (p.update.policy == UpdatePolicy::Paper) {
    refuse("points of the surface", "cannot be used with the paper's policy, which scores every point",
           "Use UpdatePolicy::Exact, or score all points");
  }
  if (p.change.mode == ChangeMode::Full) {
    refuse("points of the surface",
           "cannot be used with ChangeMode::Full: a surface that has gone would keep the points beside it from being "
           "scored",
           "Use ChangeMode::Block, or score all points");
  }
  if (p.tsdf.range_noise_m > kMostSpacing_voxels * p.tsdf.voxel_size_m) {
    refuse("range_noise_m", "is more than 32 voxels, and each point would be compared with all within it",
           "Use larger voxels, or score all points");
  }
}

void requireWindow(const FieldParams& p) {
  const auto refuse = [](const std::string& problem, const std::string& advice) {
    throw InvalidArgument("config.window", "window", problem, advice);
  };
  if (!p.origin_W) refuse("needs origin_W", "Set the origin that all tiles share");
  if (p.update.policy == UpdatePolicy::Paper) {
    refuse("cannot be combined with the paper's update policy, which depends on the whole map",
           "Use UpdatePolicy::Exact");
  }
  if (p.tsdf.region == UpdateRegion::Projective) {
    refuse("cannot be combined with projective fusion, which depends on whole scans", "Use another UpdateRegion");
  }
  if (p.tsdf.clear_rays_m > 0 || p.tsdf.platform_radius_m > 0) {
    refuse("cannot be combined with clear_rays_m or platform_radius_m, which reach beyond a tile's margin",
           "Map in one piece, or without them");
  }
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const std::int32_t low = p.window->core_low[axis], high = p.window->core_high[axis];
    if (low % FieldWindow::kEdge != 0 || high % FieldWindow::kEdge != 0 || low >= high || low < -kMostWindow_voxels ||
        high > kMostWindow_voxels) {
      refuse("has a core from " + std::to_string(low) + " to " + std::to_string(high) + " voxels",
             "Use multiples of " + std::to_string(FieldWindow::kEdge) + " within +-2^20, the lower one first");
    }
  }
}

}  // namespace

int internal::requireThreads(int threads) {
  requireRanges<&FieldParams::threads>(FieldParams{.threads = threads}, {});
  return threads;
}

FieldParams FieldParams::paper(double voxel_size_m) {
  FieldParams p;
  p.tsdf.voxel_size_m = voxel_size_m;
  p.tsdf.range_noise_m = 0;
  p.tsdf.region = UpdateRegion::FullCube;
  p.change = {ChangeMode::Off};
  p.tsdf.truncation_distance_m = std::max(4 * voxel_size_m, 0.02);
  p.tsdf.cleared_radius_voxels = 0;
  p.tsdf.cleared_begin_tau = 1;
  p.approach.coarse_to_fine = true;
  p.approach.viewpoints = true;
  p.scoring.collision_distance_m = 0.0005;
  p.scoring.form = ToolForm::SurfaceSamples;
  p.scoring.neighbours = 10;
  p.scoring.mean_positions = false;
  p.scoring.join_neighbour_views = false;
  p.scoring.neighbourhood_weight = false;
  p.update.policy = UpdatePolicy::Paper;
  return p;
}

FieldParams FieldParams::resolved() const {
  FieldParams p = *this;
  TsdfParams& t = p.tsdf;
  requireRanges<&TsdfParams::voxel_size_m, &TsdfParams::range_noise_m>(t, p);
  if (t.truncation_distance_m == 0) t.truncation_distance_m = std::max(4 * t.voxel_size_m, 5 * t.range_noise_m);
  requireRanges(t, p);
  if (t.region == UpdateRegion::Projective) requireProjective(p);
  if (t.region == UpdateRegion::Projective && (t.clear_rays_m > 0 || t.platform_radius_m > 0)) {
    throw InvalidArgument("config.clear_rays", "clear_rays_m", "is not for projective fusion",
                          "Use another UpdateRegion");
  }

  using A = ApproachParams;
  A& a = p.approach;
  // Of several bad values the first is named, and the corridor's is the last.
  requireRanges<&A::num_directions, &A::normal_cone_rad, &A::observation_cos_min, &A::arm_tau, &A::rolls>(a, p);
  requireRanges(a, p);
  // For a sphere the rule asks what the tool looks like.
  if (a.rolls == 0 && a.orientations.kind != OrientationKind::Sphere) a.rolls = 1;
  // Only space that rays passed counts as free, so the cleared band reaches as far as the corridor.
  t.cleared_end_tau = std::max(t.cleared_end_tau, a.corridor_length_m / t.truncation_distance_m);

  ScoringParams& s = p.scoring;
  if (s.collision_distance_m == 0) s.collision_distance_m = 0.5 * t.voxel_size_m;
  if (s.neighbours == 0) s.neighbours = neighboursFor(t.range_noise_m, t.voxel_size_m);
  requireRanges(s, p);
  if (s.point_spacing_m > 0) s.point_spacing_m = std::max(s.point_spacing_m, t.voxel_size_m);

  requireRanges(p.update, p);
  requireChange(p);
  if (t.region != UpdateRegion::DoubleCone) p.change = {ChangeMode::Off};
  if (p.change.mode == ChangeMode::Full && p.update.policy == UpdatePolicy::Paper) {
    throw InvalidArgument("config.change", "change full", "needs updates that follow the map in both directions",
                          "Use UpdatePolicy::Exact");
  }
  if (p.device_cache_bytes == 0) p.device_cache_bytes = deviceCacheFor(t.voxel_size_m);
  requireRanges(p, p);
  if (p.window) requireWindow(p);
  if (s.point_spacing_m > 0) requireSpacing(p);
  requireOrientations(p);
  internal::requireCarry(p.carry);
  return p;
}

std::string FieldParams::describe() const {
  std::string out;
  const auto put = [&](const std::string& name, const std::string& value) { out += name + " " + value + "\n"; };
  const auto putOrientations = [&] {
    // Only where they say something: files of yaw are those from before there was a choice.
    const bool by_rule = approach.rolls == 0 && approach.orientations.kind == OrientationKind::Sphere;
    const bool rolls = approach.rolls > 1 || by_rule;
    if (!approach.orientations.isYaw() || rolls) put("orientations", approach.orientations.text());
    if (rolls) put("rolls", text(approach.rolls));
  };
  const auto putAll = [&]<typename Params>(const auto& self, const Params& params, const std::string& prefix) -> void {
    forEachRow<Params>([&]<typename Row>(const Row& row) {
      const auto& value = params.*Row::member;
      if constexpr (Row::template is<&TsdfParams::projective>) {
        if (tsdf.region == UpdateRegion::Projective) self(self, value, "projective_");
      } else if constexpr (Row::template is<&ProjectiveParams::elevation_min_rad>) {
        put("projective_elevation_rad", text(value) + " " + text(params.elevation_max_rad));
      } else if constexpr (Row::template is<&ChangeParams::mode>) {
        // Left out when off: files are then those that were written before there was a choice, to the last byte.
        if (value != ChangeMode::Off) put(row.c_name, text(value));
      } else if constexpr (Row::template is<&ChangeParams::free_for_s>) {
        if (change.mode == ChangeMode::Full) put(row.c_name, text(value));
      } else if constexpr (Row::template is<&ScoringParams::point_spacing_m>) {
        if (value > 0) put(row.c_name, text(value));  // files of all points are those from before there was a choice
      } else if constexpr (Row::template is<&TsdfParams::clear_rays_m> ||
                           Row::template is<&TsdfParams::platform_radius_m>) {
        if (value > 0) put(row.c_name, text(value));  // likewise
      } else if constexpr (Row::template is<&ApproachParams::num_directions>) {
        put(row.c_name, text(value));
        putOrientations();
      } else if constexpr (!Row::template is<&ProjectiveParams::elevation_max_rad> &&
                           !Row::template is<&ApproachParams::orientations> &&
                           !Row::template is<&ApproachParams::rolls>) {
        put(prefix + row.c_name, text(value));
      }
    });
  };
  // Parts only: where a field runs decides no result, and tiles are described as the map that they make.
  forEachRow<FieldParams>([&]<typename Row>(const Row&) {
    const auto& value = this->*Row::member;
    if constexpr (ParamStruct<std::remove_cvref_t<decltype(value)>>) putAll(putAll, value, "");
  });
  if (const std::string names = carryText(carry); !names.empty()) put("carry", names);
  return out;
}

}  // namespace accessvdb
