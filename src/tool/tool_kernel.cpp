// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_kernel.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include "accessvdb/error.h"
#include "tool/grown_voxels.h"
#include "tool/orientation_count.h"
#include "tool/surface_samples.h"
#include "tool/tool_solid.h"
#include "tool/voxel_runs.h"
#include "tool/voxelize.h"
#include "tool/yaw_direction.h"

namespace accessvdb::internal {
namespace {

/// Offsets are int16; this leaves room for adding them to a voxel's place in its leaf.
constexpr double kMaxSpanVoxels = 30000;
/// 2^28 columns of 16 bytes: 4 GiB on the host, twice that while they are assembled, and 4 GiB on the device.
/// `builtin:pruner` with 180 directions takes 2.8 GiB of it at 1 mm.
constexpr double kMaxColumns = 268435456.0;
/// [n_c] of 1000 surface samples (paper).
constexpr int kSampleCollisionLimit = 5;
/// Share of the tool's voxels that may collide: noise of single voxels must not block a direction.
constexpr double kCollisionShare = 0.005;

/// Row by row, so that yaw alone rounds nothing but (cos x - sin y, sin x + cos y, z).
Eigen::Vector3d turned(const Eigen::Matrix3d& R_WT, double x, double y, double z) {
  const auto row = [&](Eigen::Index n) { return R_WT(n, 0) * x + R_WT(n, 1) * y + R_WT(n, 2) * z; };
  return {row(0), row(1), row(2)};
}

/// @throws InvalidArgument "tool.margin"  for one that voxels cannot show, or samples of the surface
void requireMargin(const ToolGeometry& tool, const FieldParams& resolved) {
  const double margin_m = tool.margin_m(), voxel_size_m = resolved.tsdf.voxel_size_m;
  if (margin_m == 0) return;
  const std::string named = std::to_string(margin_m) + " m";
  if (resolved.scoring.form == ToolForm::SurfaceSamples) {
    throw InvalidArgument("tool.margin", named, "samples of a tool's surface have no margin", "Use ToolForm::Voxels");
  }
  if (margin_m * (1 + 1e-9) < voxel_size_m) {
    throw InvalidArgument("tool.margin", named, "is less than a voxel of " + std::to_string(voxel_size_m) + " m",
                          "Leave it out, or use a smaller voxel_size_m");
  }
  if (margin_m > kMostMargin_voxels * voxel_size_m) {
    throw InvalidArgument("tool.margin", named,
                          "is more than " + std::to_string(static_cast<int>(kMostMargin_voxels)) + " voxels",
                          "Use a smaller margin, or a larger voxel_size_m");
  }
}

/// Lower bound on the columns of all directions, from the surface area: one column per direction for each cell of the
/// ground below the surface. Low by design (steep walls count little), so that only hopeless cases are refused.
double fewestColumns(const ToolGeometry& tool, double voxel_size_m, const ApproachParams& approach) {
  if (!approach.orientations.isYaw()) return 0;  // from other sides, other triangles are above each other
  double ground_m2 = 0;
  for (const auto& t : tool.triangles()) {
    const Eigen::Vector3d a = tool.vertices_T()[t[0]].cast<double>(), b = tool.vertices_T()[t[1]].cast<double>(),
                          c = tool.vertices_T()[t[2]].cast<double>();
    ground_m2 = std::max(ground_m2, 0.5 * std::abs((b - a).x() * (c - a).y() - (b - a).y() * (c - a).x()));
  }
  return ground_m2 / (voxel_size_m * voxel_size_m) * approach.num_directions;
}

/// The least STEP, in whole quarters of a degree, with which the tables over a sphere fit. @param columns  with that of
/// now, about evenly over all directions
double fittingStep_deg(const ApproachParams& approach, double columns) {
  const double each = columns / approach.directionCount();
  OrientationSet set = approach.orientations;
  set.step_deg = std::ceil(4 * set.step_deg) / 4;
  while (set.step_deg < 90 && each * set.count(approach.num_directions) > kMaxColumns) set.step_deg += 0.25;
  return set.step_deg;
}

/// @param columns  number for all directions, or an estimate
[[noreturn]] void refuseColumns(const ToolGeometry& tool, const FieldParams& resolved, int rolls, double columns) {
  const double voxel_size_m = resolved.tsdf.voxel_size_m;
  const ApproachParams& approach = resolved.approach;
  constexpr double kGiB = 1073741824.0;
  const auto text = [](double value, const char* format) {
    char number[32];
    std::snprintf(number, sizeof number, format, value);
    return std::string(number);
  };
  // Columns grow at least with the square of 1 / v. Rounded up to whole tenths of a millimetre.
  const double fits_m = std::ceil(voxel_size_m * std::sqrt(columns / kMaxColumns) * 1e4) * 1e-4;
  std::string fewer = "fewer directions, ";
  if (approach.orientations.kind == OrientationKind::Pitch) fewer = "a larger STEP of ApproachParams::orientations, ";
  if (approach.orientations.kind == OrientationKind::Sphere) {
    fewer = "a STEP of ApproachParams::orientations of " + text(fittingStep_deg(approach, columns), "%g") +
            " degrees or larger, ";
  }
  throw ResourceLimit(
      "tool.columns", tool.name(),
      "at a voxel size of " + text(voxel_size_m, "%.6g") + " m the tool's tables for all directions take " +
          text(columns * sizeof(kernels::VoxelColumn) / kGiB, "%.1f") + " GiB; at most " +
          text(kMaxColumns * sizeof(kernels::VoxelColumn) / kGiB, "%.0f") + " GiB can be handled",
      "Use voxel_size_m " + text(fits_m, "%.6g") + " or larger, " + fewer +
          (rolls > 1 ? "fewer ApproachParams::rolls than " + std::to_string(rolls) + " " : "") + "or a smaller tool");
}

std::uint16_t limited(double limit) { return std::uint16_t(std::clamp(limit, 1.0, 65534.0)); }
/// @param fewest  voxels of any yaw direction
std::uint16_t limitByRule(std::uint32_t fewest) {
  return limited(std::max(1.0, std::floor(kCollisionShare * fewest)) + 1);
}

struct Box {
  std::array<int, 3> low = {std::numeric_limits<int>::max(), std::numeric_limits<int>::max(),
                            std::numeric_limits<int>::max()};
  std::array<int, 3> high = {std::numeric_limits<int>::min(), std::numeric_limits<int>::min(),
                             std::numeric_limits<int>::min()};

  void add(int i, int j, int k) {
    const std::array<int, 3> p = {i, j, k};
    for (int a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], p[a]);
      high[a] = std::max(high[a], p[a]);
    }
  }
};

double hiddenShare(const SolidVoxels& voxels) {
  return voxels.all > 0 ? 1 - double(voxels.all - voxels.hidden) / double(voxels.all) : 0;
}

/// Voxels of the tool left after self-exclusion, at the yaw direction that has the fewest.
std::uint32_t fewestYawVoxels(const ToolGeometry& tool, const FieldParams& resolved, OrientationCount& count) {
  const std::vector<ToolOrientation> yaws = OrientationSet::yaw().orientations(resolved.approach.num_directions);
  std::vector<std::uint64_t> voxels(yaws.size());
  const ToolSolid solid(tool);
  const double v = resolved.tsdf.voxel_size_m;
  tbb::parallel_for(std::size_t{0}, yaws.size(), [&](std::size_t d) {
    voxels[d] =
        solid.voxels(turnedVertices(tool, yaws[d].R_WT, 1 / v), v, resolved.scoring.self_exclusion_voxels).counted;
    count.addOne();
  });
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(*std::min_element(voxels.begin(), voxels.end()),
                                                            std::numeric_limits<std::uint32_t>::max()));
}

}  // namespace

std::vector<Eigen::Vector3d> turnedVertices(const ToolGeometry& tool, const Eigen::Matrix3d& R_WT, double scale) {
  std::vector<Eigen::Vector3d> out;
  out.reserve(tool.vertices_T().size());
  for (const Eigen::Vector3f& p : tool.vertices_T())
    out.push_back(turned(R_WT, p.x() * scale, p.y() * scale, p.z() * scale));
  return out;
}

kernels::ToolKernelView ToolKernel::view() const {
  return {columns.data(),
          column_begin.data(),
          samples.data(),
          sample_begin.data(),
          use_samples,
          collision_limit,
          {{min_ijk[0], min_ijk[1], min_ijk[2]}, {max_ijk[0], max_ijk[1], max_ijk[2]}},
          parts()};
}

namespace {

/// @param all_directions  as many as the set has; the orientations may be some of them
ToolKernel makeKernel(const ToolGeometry& tool, const FieldParams& resolved,
                      const std::vector<ToolOrientation>& orientations, int all_directions, const ToolRolls& rolls,
                      OrientationCount& count) {
  const double v = resolved.tsdf.voxel_size_m, exclusion = resolved.scoring.self_exclusion_voxels;
  const auto num_directions = static_cast<int>(orientations.size());
  const auto D = std::size_t(num_directions);
  const double span_voxels =
      std::max(double(tool.reach_m()), (tool.max_T() - tool.min_T()).cast<double>().maxCoeff()) / v;
  if (!(span_voxels <= kMaxSpanVoxels)) {
    throw ResourceLimit("tool.span", tool.name(),
                        "the tool spans " + std::to_string(std::llround(std::min(span_voxels, 1e15))) +
                            " voxels; at most 30000 can be handled",
                        "Use a larger voxel_size_m, or check LengthUnit and ToolPose::tip");
  }
  requireMargin(tool, resolved);
  if (const double fewest = fewestColumns(tool, v, resolved.approach); fewest > kMaxColumns) {
    refuseColumns(tool, resolved, rolls.count, fewest);
  }

  ToolKernel kernel;
  kernel.num_directions = num_directions;
  kernel.rolls = rolls;
  kernel.voxel_count.resize(D);
  const auto P = std::size_t(kernel.parts());
  std::vector<std::vector<kernels::VoxelColumn>> of_part(D * P);
  const auto R = std::size_t(rolls.count);
  std::vector<Box> boxes(D * R);
  std::vector<double> hidden(D * R, 0);
  const ToolSolid solid(tool);
  const auto voxelsOf = [&](std::size_t d, std::size_t roll) {
    const ToolOrientation held = rolledBy(orientations[d], rolls, int(roll));
    SolidVoxels voxels = solid.voxels(turnedVertices(tool, held.R_WT, 1 / v), v, exclusion);
    std::vector<VoxelRun>& runs = voxels.runs;
    Box& box = boxes[d * R + roll];
    for (const VoxelRun& run : runs) {
      box.add(run.i, run.j, run.lo);
      box.add(run.i, run.j, run.hi);
    }
    if (roll == 0) {
      kernel.voxel_count[d] =
          std::uint32_t(std::min<std::uint64_t>(voxels.counted, std::numeric_limits<std::uint32_t>::max()));
    }
    hidden[d * R + roll] = hiddenShare(voxels);
    count.addOne();
    return std::move(runs);
  };
  const auto makeDirection = [&](std::size_t d) {
    auto* const parts = of_part.data() + d * P;
    if (R == 1) {
      parts[0] = packColumns(voxelsOf(d, 0));
      return;
    }
    std::vector<std::vector<VoxelRun>> of_roll(R);
    // While it waits for the rolls, a thread begins no other direction, whose voxels would need memory, too.
    tbb::this_task_arena::isolate(
        [&] { tbb::parallel_for(std::size_t{0}, R, [&](std::size_t roll) { of_roll[roll] = voxelsOf(d, roll); }); });
    std::vector<VoxelRun> core = of_roll[0];
    for (const std::vector<VoxelRun>& runs : of_roll) core = sharedVoxels(core, runs);
    parts[0] = packColumns(core);
    for (std::size_t roll = 0; roll < R; ++roll) parts[roll + 1] = packColumns(voxelsWithout(of_roll[roll], core));
  };
  makeDirection(0);  // first, so that what does not fit is noticed before memory fills up
  std::size_t of_first = 0;
  for (std::size_t part = 0; part < P; ++part) of_first += of_part[part].size();
  if (const double all = double(of_first) * all_directions; all > kMaxColumns) {
    refuseColumns(tool, resolved, rolls.count, all);
  }
  tbb::parallel_for(std::size_t{1}, D, makeDirection);

  std::size_t num_columns = 0;
  kernel.column_begin.push_back(0);
  for (const auto& columns : of_part) {
    num_columns += columns.size();
    if (double(num_columns) > kMaxColumns) refuseColumns(tool, resolved, rolls.count, double(num_columns));
    kernel.column_begin.push_back(std::uint32_t(num_columns));
  }
  kernel.columns.reserve(num_columns);
  for (auto& columns : of_part) {
    kernel.columns.insert(kernel.columns.end(), columns.begin(), columns.end());
    std::vector<kernels::VoxelColumn>().swap(columns);
  }
  Box box;
  for (const Box& own : boxes) {
    if (own.low[0] > own.high[0]) continue;
    box.add(own.low[0], own.low[1], own.low[2]);
    box.add(own.high[0], own.high[1], own.high[2]);
  }

  kernel.sample_begin.assign(D * P + 1, 0);
  kernel.use_samples = resolved.scoring.form == ToolForm::SurfaceSamples;
  if (kernel.use_samples) {
    std::vector<Eigen::Vector3d> samples =
        sampleSurface(tool.vertices_T(), tool.triangles(), resolved.scoring.surface_samples);
    std::erase_if(samples, [&](const Eigen::Vector3d& p) { return p.norm() <= exclusion * v; });
    kernel.samples.reserve(3 * samples.size() * D * R);
    for (std::size_t n = 0; n < D * R; ++n) {
      const std::size_t d = n / R, roll = n % R;
      const std::size_t part = P == 1 ? d : d * P + 1 + roll;
      if (roll == 0) kernel.sample_begin[part] = std::uint32_t(kernel.samples.size() / 3);  // the core has none
      const ToolOrientation held = rolledBy(orientations[d], rolls, int(roll));
      for (const Eigen::Vector3d& p : samples) {
        const Eigen::Vector3d q = turned(held.R_WT, p.x(), p.y(), p.z());
        int low[3], high[3];
        for (int a = 0; a < 3; ++a) {
          kernel.samples.push_back(float(q[a]));
          // The point may be anywhere in its voxel, so a sample may fall into either of two; the margin is for float32.
          low[a] = int(std::floor(q[a] / v - 1e-3));
          high[a] = int(std::floor(q[a] / v + 1 + 1e-3));
        }
        box.add(low[0], low[1], low[2]);
        box.add(high[0], high[1], high[2]);
      }
      kernel.sample_begin[part + 1] = std::uint32_t(kernel.samples.size() / 3);
    }
  }
  kernel.hidden_share = *std::max_element(hidden.begin(), hidden.end());
  if (box.low[0] <= box.high[0]) kernel.min_ijk = box.low, kernel.max_ijk = box.high;

  if (resolved.scoring.max_collisions != 0) {
    kernel.collision_limit = limited(std::max(0.0, double(resolved.scoring.max_collisions)) + 1);
  } else if (kernel.use_samples) {
    kernel.collision_limit = kSampleCollisionLimit;
  } else {
    kernel.collision_limit = limitByRule(*std::min_element(kernel.voxel_count.begin(), kernel.voxel_count.end()));
  }
  return kernel;
}

}  // namespace

ToolKernel ToolKernel::make(const ToolGeometry& tool, const FieldParams& resolved,
                            const ExpandedOrientations& orientations, const TableProgress& progress) {
  const bool by_rule = resolved.scoring.max_collisions == 0 && resolved.scoring.form != ToolForm::SurfaceSamples;
  const bool counts_yaw = by_rule && !orientations.is_yaw;  // of yaw, voxel_count is without roll
  const ToolRolls rolls = toolRolls(tool, resolved.approach);
  OrientationCount count(progress, orientations.all.size() * std::size_t(rolls.count) +
                                       (counts_yaw ? std::size_t(resolved.approach.num_directions) : 0));
  ToolKernel kernel = makeKernel(tool, resolved, orientations.all, orientations.count(), rolls, count);
  if (counts_yaw) kernel.collision_limit = limitByRule(fewestYawVoxels(tool, resolved, count));
  return kernel;
}

ToolKernel ToolKernel::sampled(const ToolGeometry& tool, const FieldParams& resolved, const ExpandedOrientations& all,
                               int most) {
  const TableProgress nobody;
  OrientationCount count(nobody, 0);
  return makeKernel(tool, resolved, all.sampled(most).all, all.count(), toolRolls(tool, resolved.approach), count);
}

double largestHiddenShare(const ToolGeometry& tool, const FieldParams& resolved) {
  const ToolRolls rolls = toolRolls(tool, resolved.approach);
  const std::vector<ToolOrientation> orientations = ExpandedOrientations::of(resolved.approach).all;
  const ToolSolid solid(tool);
  const double v = resolved.tsdf.voxel_size_m;
  const auto R = std::size_t(rolls.count);
  std::vector<double> hidden(orientations.size() * R);
  tbb::parallel_for(std::size_t{0}, hidden.size(), [&](std::size_t n) {
    const ToolOrientation held = rolledBy(orientations[n / R], rolls, int(n % R));
    hidden[n] =
        hiddenShare(solid.voxels(turnedVertices(tool, held.R_WT, 1 / v), v, resolved.scoring.self_exclusion_voxels));
  });
  return *std::max_element(hidden.begin(), hidden.end());
}

}  // namespace accessvdb::internal
