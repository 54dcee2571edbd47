// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One row per parameter: its field, its field in C, its range, and what it is. FieldParams::resolved() and describe(),
/// saved states, C and Python go through these rows, so a new parameter is a field of params.h, a row here and, for C,
/// a field of c_api.h. Rules that derive one value from others are code, in FieldParams::resolved().
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <numbers>
#include <tuple>
#include <type_traits>

#include "accessvdb/c_api.h"
#include "accessvdb/params.h"

namespace accessvdb {

/// The words for an enum's values, in its order: of files, options, descriptions and Python.
template <typename Enum>
inline constexpr std::array<const char*, 0> kEnumWords = {};
template <>
inline constexpr std::array kEnumWords<BackendKind> = {"auto", "cpu", "cuda"};
template <>
inline constexpr std::array kEnumWords<UpdateRegion> = {"double_cone", "full_cube", "projective"};
template <>
inline constexpr std::array kEnumWords<ToolForm> = {"voxels", "surface_samples"};
template <>
inline constexpr std::array kEnumWords<UpdatePolicy> = {"exact", "paper"};
template <>
inline constexpr std::array kEnumWords<ChangeMode> = {"off", "block", "full"};

/// What a number may be, both ends included. NaN is never within.
struct ParamRange {
  double low = 0, high = 0;
  const char* advice = "";
};
/// Of what has no range, or one that resolved() has the code for.
struct AnyValue {};

/// @param Range  ParamRange, AnyValue, or a function of FieldParams that returns a ParamRange
template <auto kMember, auto kMemberInC, typename Range>
struct ParamRow {
  const char* name;  ///< of the field, and in Python
  Range range;
  const char* words;   ///< [symbol in the paper], meaning, unit; the docstring in Python
  const char* c_name;  ///< in descriptions, errors and C

  static constexpr auto member = kMember;          ///< pointer to the member of its struct
  static constexpr auto member_in_C = kMemberInC;  ///< of accessvdb_params; nullptr where C has none
  static constexpr bool has_C = !std::is_null_pointer_v<decltype(kMemberInC)>;
  static constexpr bool has_range = !std::is_same_v<Range, AnyValue>;

  /// @param all  of which others may decide the ends
  [[nodiscard]] constexpr ParamRange rangeIn(const FieldParams& all) const {
    if constexpr (std::is_same_v<Range, ParamRange>) {
      return range;
    } else {
      return range(all);
    }
  }
  template <auto kOther>
  static constexpr bool is = std::is_same_v<std::integral_constant<decltype(kMember), kMember>,
                                            std::integral_constant<decltype(kOther), kOther>>;
};

template <auto kMember, auto kMemberInC = nullptr, typename Range>
constexpr ParamRow<kMember, kMemberInC, Range> paramRow(const char* name, Range range, const char* words) {
  return {name, range, words, name};
}
/// A parameter that is called `c_name` outside its struct.
template <auto kMember, auto kMemberInC = nullptr, typename Range>
constexpr ParamRow<kMember, kMemberInC, Range> paramRow(const char* name, const char* c_name, Range range,
                                                        const char* words) {
  return {name, range, words, c_name};
}

/// The rows of a struct of parameters, in the order of its fields.
template <typename Params>
inline constexpr auto kParamRows = std::tuple();

template <>
inline constexpr auto kParamRows<ProjectiveParams> = std::tuple(
    paramRow<&ProjectiveParams::bin_rad>("bin_rad", ParamRange{0.0005, 0.2},
                                         "Edge of a bin; rounded to a whole number of bins per turn."),
    paramRow<&ProjectiveParams::in_front>("in_front", AnyValue{},
                                          "Voxels more than tau in front of a range count as tau."),
    paramRow<&ProjectiveParams::empty_is_free>("empty_is_free", AnyValue{},
                                               "Voxels in empty bins count as tau; else they are skipped."),
    paramRow<&ProjectiveParams::guarded>(
        "guarded", AnyValue{}, "nvblox's interpolation with its two guards; else the nearest range of the bin."),
    paramRow<&ProjectiveParams::cleared_band>("cleared_band", AnyValue{},
                                              "Also mark the cleared band of the scan-centric method."),
    paramRow<&ProjectiveParams::elevation_min_rad>("elevation_min_rad",
                                                   ParamRange{-std::numbers::pi / 2, std::numbers::pi / 2},
                                                   "Empty bins below this elevation are outside the view."),
    paramRow<&ProjectiveParams::elevation_max_rad>(
        "elevation_max_rad",
        [](const FieldParams& p) {
          return ParamRange{p.tsdf.projective.elevation_min_rad, std::numbers::pi / 2};
        },
        "Empty bins above this elevation are outside the view."),
    paramRow<&ProjectiveParams::box_min_W_m>("box_min_W_m", AnyValue{},
                                             "What in_front and empty_is_free may update, world frame: lowest corner."),
    paramRow<&ProjectiveParams::box_max_W_m>("box_max_W_m", AnyValue{}, "And its highest corner."));

template <>
inline constexpr auto kParamRows<TsdfParams> = std::tuple(
    paramRow<&TsdfParams::voxel_size_m, &accessvdb_params::voxel_size_m>(
        "voxel_size_m", ParamRange{0.0005, 10, "Choose a voxel between 0.5 mm and 10 m"},
        "[v] Edge length of a voxel; 0.0005 .. 10."),
    paramRow<&TsdfParams::truncation_distance_m, &accessvdb_params::truncation_distance_m>(
        "truncation_distance_m",
        [](const FieldParams& p) {
          return ParamRange{p.tsdf.voxel_size_m, 100 * p.tsdf.voxel_size_m,
                            "tau must be between 1 and 100 voxels; choose a larger voxel or a smaller tau"};
        },
        "[tau] 0 = rule: max(4 v, 5 range_noise_m)."),
    paramRow<&TsdfParams::range_noise_m, &accessvdb_params::range_noise_m>("range_noise_m", ParamRange{0, 10},
                                                                           "Sigma of the sensor's range noise."),
    paramRow<&TsdfParams::min_range_m, &accessvdb_params::min_range_m>("min_range_m", ParamRange{0, 1e6},
                                                                       "Returns nearer than this are dropped."),
    paramRow<&TsdfParams::max_range_m, &accessvdb_params::max_range_m>(
        "max_range_m",
        [](const FieldParams& p) {
          return ParamRange{p.tsdf.min_range_m, std::numeric_limits<double>::infinity()};
        },
        "Returns beyond this are dropped."),
    paramRow<&TsdfParams::region, &accessvdb_params::region>(
        "region", AnyValue{}, "Which voxels a return updates: \"double_cone\", \"full_cube\" or \"projective\"."),
    paramRow<&TsdfParams::projective>("projective", AnyValue{}, "Only for region \"projective\"."),
    paramRow<&TsdfParams::cone_cos_min, &accessvdb_params::cone_cos_min>("cone_cos_min", ParamRange{0.85, 0.9999},
                                                                         "Cosine of the cone's half angle; (0, 1)."),
    paramRow<&TsdfParams::clamp_min_m, &accessvdb_params::clamp_min_m>(
        "clamp_min_m", [](const FieldParams& p) { return ParamRange{-p.tsdf.truncation_distance_m, 0}; },
        "Lower clamp of a distance sample: 0, or -tau for the unclamped variant."),
    paramRow<&TsdfParams::max_weight, &accessvdb_params::max_weight>("max_weight", ParamRange{1, 4095},
                                                                     "[w] Cap in observations; 1 .. 4095."),
    paramRow<&TsdfParams::cleared_radius_voxels, &accessvdb_params::cleared_radius_voxels>(
        "cleared_radius_voxels", ParamRange{0, 16}, "Cleared band: distance from the ray."),
    paramRow<&TsdfParams::cleared_begin_tau, &accessvdb_params::cleared_begin_tau>(
        "cleared_begin_tau", ParamRange{0, 10}, "Cleared band: beginning, times tau, from the return."),
    paramRow<&TsdfParams::cleared_end_tau, &accessvdb_params::cleared_end_tau>(
        "cleared_end_tau", [](const FieldParams& p) { return ParamRange{p.tsdf.cleared_begin_tau, 100}; },
        "Cleared band: end, times tau."),
    paramRow<&TsdfParams::clear_rays_m, &accessvdb_params::clear_rays_m>(
        "clear_rays_m", ParamRange{0, std::numeric_limits<double>::infinity()},
        "Rays clear a line beyond the band, up to so far from their returns; inf: to the sensor. 0: only the band."),
    paramRow<&TsdfParams::platform_radius_m, &accessvdb_params::platform_radius_m>(
        "platform_radius_m",
        [](const FieldParams& p) {
          return ParamRange{0, kMostPlatform_voxels * p.tsdf.voxel_size_m, "The platform is at most 128 voxels large"};
        },
        "A ball of this radius around the sensor's positions is free; 0: none is."));

template <>
inline constexpr auto kParamRows<ApproachParams> = std::tuple(
    paramRow<&ApproachParams::num_directions, &accessvdb_params::num_directions>(
        "num_directions", ParamRange{4, 256, "Up to 256 directions are supported"},
        "[D] Yaw steps over 2 pi; 4 .. 256."),
    paramRow<&ApproachParams::normal_cone_rad, &accessvdb_params::normal_cone_rad>(
        "normal_cone_rad", ParamRange{0.01, std::numbers::pi / 2}, "Largest angle between a direction and the normal."),
    paramRow<&ApproachParams::observation_cos_min, &accessvdb_params::observation_cos_min>(
        "observation_cos_min", ParamRange{-1, 1},
        "A direction was observed if its dot product with the ray exceeds this."),
    paramRow<&ApproachParams::arm_tau, &accessvdb_params::arm_tau>("arm_tau", ParamRange{0, 100},
                                                                   "Distances of the arm samples, times tau."),
    paramRow<&ApproachParams::corridor_length_m, &accessvdb_params::corridor_length_m>(
        "corridor_length_m",
        [](const FieldParams&
               p) { return ParamRange{0, 50 * p.tsdf.truncation_distance_m, "A corridor is at most 50 tau long"}; },
        "[L] Straight corridor kept free."),
    paramRow<&ApproachParams::coarse_to_fine, &accessvdb_params::coarse_to_fine>(
        "coarse_to_fine", AnyValue{}, "The paper's 20 degree pass; policy \"paper\" only."),
    paramRow<&ApproachParams::viewpoints, &accessvdb_params::viewpoints>(
        "viewpoints", AnyValue{}, "Up to 8 stored viewpoints (paper) instead of the seen-direction mask."),
    paramRow<&ApproachParams::orientations, &accessvdb_params::orientations>(
        "orientations", AnyValue{},
        "How the tool can be turned, degrees: \"yaw\", \"pitch:MIN:MAX:STEP\", \"sphere:STEP\", "
        "\"sphere:STEP+yaw\" or \"list:FILE\"; or rows of yaw, pitch, roll, or of a quaternion w, x, y, z."),
    paramRow<&ApproachParams::rolls, &accessvdb_params::rolls>(
        "rolls", ParamRange{0, 64, "Up to 64 rolls are supported; 0 chooses by rule"},
        "How many rolls about its body the tool may take in each; 0 = rule."));

template <>
inline constexpr auto kParamRows<ScoringParams> = std::tuple(
    paramRow<&ScoringParams::collision_distance_m, &accessvdb_params::collision_distance_m>(
        "collision_distance_m",
        [](const FieldParams& p) {
          return ParamRange{1e-6, p.tsdf.truncation_distance_m};
        },
        "[r_c] 0 = rule: 0.5 v."),
    paramRow<&ScoringParams::self_exclusion_voxels, &accessvdb_params::self_exclusion_voxels>("self_exclusion_voxels",
                                                                                              ParamRange{0, 100},
                                                                                              "[r_s] In voxels."),
    paramRow<&ScoringParams::form, &accessvdb_params::tool_form>(
        "form", "tool_form", AnyValue{}, "How tool collisions are counted: \"voxels\" or \"surface_samples\"."),
    paramRow<&ScoringParams::surface_samples, &accessvdb_params::surface_samples>(
        "surface_samples", ParamRange{10, 1'000'000}, "[M] Only for form \"surface_samples\"."),
    paramRow<&ScoringParams::max_collisions, &accessvdb_params::max_collisions>(
        "max_collisions", ParamRange{-1, 65000, "0 is the rule, -1 is none"},
        "[n_c - 1] Most collisions of a free direction; 0 = rule, -1 = none."),
    paramRow<&ScoringParams::neighbours, &accessvdb_params::neighbours>(
        "neighbours", ParamRange{3, 500}, "[k] Neighbours for the normal's PCA; 0 = rule."),
    paramRow<&ScoringParams::mean_positions, &accessvdb_params::mean_positions>(
        "mean_positions", AnyValue{}, "PCA on mean return positions; else on first returns."),
    paramRow<&ScoringParams::join_neighbour_views, &accessvdb_params::join_neighbour_views>(
        "join_neighbour_views", AnyValue{},
        "A point inherits the directions that its 10 nearest neighbours were seen from."),
    paramRow<&ScoringParams::neighbourhood_weight, &accessvdb_params::neighbourhood_weight>(
        "neighbourhood_weight", AnyValue{}, "Confidence from the largest weight of 3x3x3 voxels."),
    paramRow<&ScoringParams::confidence_half_weight, &accessvdb_params::confidence_half_weight>(
        "confidence_half_weight", ParamRange{0.01, 1000}, "[k_c] c = w / (w + k_c)."),
    paramRow<&ScoringParams::confidence_min, &accessvdb_params::confidence_min>(
        "confidence_min", ParamRange{0, 0.99}, "[c_min] Points below are not scored."),
    paramRow<&ScoringParams::point_spacing_m, &accessvdb_params::point_spacing_m>(
        "point_spacing_m",
        [](const FieldParams& p) {
          return ParamRange{0, std::min(p.tsdf.truncation_distance_m, kMostSpacing_voxels * p.tsdf.voxel_size_m),
                            "Points may be spaced by at most tau and 32 voxels; 0 scores them all"};
        },
        "0: every point is scored. Above: one for each cell of this edge, where the surface is."));

template <>
inline constexpr auto kParamRows<UpdateParams> = std::tuple(
    paramRow<&UpdateParams::policy, &accessvdb_params::policy>("policy", AnyValue{}, "\"exact\" or \"paper\"."),
    paramRow<&UpdateParams::budget_points, &accessvdb_params::budget_points>(
        "budget_points", ParamRange{0, 2'000'000'000}, "Most points scored per update(); 0 = no limit."),
    paramRow<&UpdateParams::changed_voxel_sample, &accessvdb_params::changed_voxel_sample>(
        "changed_voxel_sample", ParamRange{0, 1'000'000}, "Policy \"paper\", trigger (ii)."),
    paramRow<&UpdateParams::changed_voxel_radius_voxels, &accessvdb_params::changed_voxel_radius_voxels>(
        "changed_voxel_radius_voxels", ParamRange{0, 100}, "[r_u] Policy \"paper\", trigger (ii)."),
    paramRow<&UpdateParams::requeue_motion_m, &accessvdb_params::requeue_motion_m>("requeue_motion_m",
                                                                                   ParamRange{0, 1000},
                                                                                   "Policy \"paper\", trigger (iii)."),
    paramRow<&UpdateParams::stability_min, &accessvdb_params::stability_min>(
        "stability_min", ParamRange{0, 1}, "Bound on confidence times stability for `confident`."),
    paramRow<&UpdateParams::seed, &accessvdb_params::seed>("seed", AnyValue{},
                                                           "Seed of the sample of policy \"paper\"."));

template <>
inline constexpr auto kParamRows<ChangeParams> = std::tuple(
    paramRow<&ChangeParams::mode, &accessvdb_params::change>(
        "mode", "change", AnyValue{},
        "\"off\": the world is still; \"block\": new things block within a few scans; \"full\": what is gone opens "
        "by evidence, too. Off unless the region is \"double_cone\"."),
    paramRow<&ChangeParams::free_for_s, &accessvdb_params::free_for_s>(
        "free_for_s",
        [](const FieldParams& p) {
          constexpr double kForever_s = std::numeric_limits<double>::infinity();
          if (p.change.free_for_s == kForever_s) return ParamRange{0.001, kForever_s};
          return ParamRange{0.001, 1e9, "Give the seconds for which free space stays free, or infinity"};
        },
        "[T] seconds, by the stamps of the scans: free space that no ray has confirmed for T to 2 T is unknown "
        "again. inf: it stays free. Finite only with \"full\"."));

template <>
inline constexpr auto kParamRows<FieldParams> = std::tuple(
    paramRow<&FieldParams::tsdf>("tsdf", AnyValue{}, "How scans are fused."),
    paramRow<&FieldParams::approach>("approach", AnyValue{}, "Which directions are admissible."),
    paramRow<&FieldParams::scoring>("scoring", AnyValue{}, "How a direction is scored."),
    paramRow<&FieldParams::update>("update", AnyValue{}, "When points are scored again."),
    paramRow<&FieldParams::change>("change", AnyValue{}, "How the map follows a world that changes."),
    paramRow<&FieldParams::backend, &accessvdb_params::backend>("backend", AnyValue{},
                                                                "Where scoring runs: \"auto\", \"cpu\" or \"cuda\"."),
    // TBB keeps a slot for each thread of an arena, and crashes where it has no memory for them.
    paramRow<&FieldParams::threads, &accessvdb_params::threads>("threads", ParamRange{0, 4096, "0 uses all"},
                                                                "0 = all."),
    paramRow<&FieldParams::mirror_distance>(
        "mirror_distance", AnyValue{},
        "Keeps a second live mirror, of the map's distances, for kernels in C++ (DeviceView); no result depends "
        "on it."),
    paramRow<&FieldParams::fuse_on_host, &accessvdb_params::fuse_on_host>(
        "fuse_on_host", AnyValue{}, "On a GPU: fuses each scan on the host before it is scored; same labels, later."),
    paramRow<&FieldParams::device_cache_bytes, &accessvdb_params::device_cache_bytes>(
        "device_cache_bytes", ParamRange{64e6, 1e15, "Use 64 MB or more, or leave it out for what the voxels need"},
        "On a GPU: most of its memory for the values of the map; no result depends on it. 0 = rule, by the voxel size: "
        "4 GB at 10 mm, 20 GB at 5 mm, and half of what is free at most."),
    paramRow<&FieldParams::origin_W>("origin_W", ParamRange{-1e8, 1e8}, "World position of the local frame, metres."),
    paramRow<&FieldParams::window>("window", AnyValue{}, "Limits the field to one tile."),
    paramRow<&FieldParams::carry, &accessvdb_params::carry>(
        "carry", AnyValue{},
        "Names of what returns carry to the points: the value of most of a point's returns, "
        "of several the lowest. Files have a column of each."));

/// A struct that has rows.
template <typename Params>
concept ParamStruct = std::tuple_size_v<decltype(kParamRows<Params>)> >
0;

/// Calls visit(row) for each row of a struct, in order.
template <ParamStruct Params, typename Visit>
constexpr void forEachRow(Visit&& visit) {
  std::apply([&](const auto&... row) { (visit(row), ...); }, kParamRows<Params>);
}

}  // namespace accessvdb
