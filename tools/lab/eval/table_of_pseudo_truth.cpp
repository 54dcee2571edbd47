// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How far pseudo truth can be trusted: scenes whose truth is exact, judged by both.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "eval/pseudo_truth.h"
#include "eval/table_context.h"

namespace accessvdb::eval {
namespace {

/// Of the F1 by pseudo truth from that by exact truth, points.
constexpr double kMostDifference = 1;

/// One with few frames is as sparse as recordings are: less than a return in two voxels in either half.
struct CalibrationCase {
  const char* scene;
  double noise_v;  ///< range noise, voxels
  int frames = 0;  ///< 0 = the benchmark's
  double voxel_m = 0.002;
};
constexpr CalibrationCase kCases[] = {{"torus", 0},      {"torus", 1},      {"sphere_b", 0},     {"sphere_b", 1},
                                      {"box", 0},        {"box", 1},        {"unseen_2", 0},     {"unseen_2", 1},
                                      {"torus", 0, 100}, {"torus", 1, 100}, {"unseen_2", 0, 60}, {"unseen_2", 1, 60}};

/// Pseudo truth against exact truth on the points that pseudo truth judges.
struct Comparison {
  Confusion by_verdict, by_truth;  ///< of the labels
  std::uint64_t unlike = 0;        ///< verdicts that are not the truth

  [[nodiscard]] double difference() const { return by_verdict.f1() - by_truth.f1(); }
  [[nodiscard]] double unlikePercent() const {
    return by_truth.points() == 0 ? 0 : 100 * static_cast<double>(unlike) / static_cast<double>(by_truth.points());
  }
};

Comparison compared(const std::vector<PseudoVerdict>& verdicts, const std::vector<std::uint8_t>& truth,
                    const std::vector<std::uint8_t>& found) {
  Comparison result;
  for (std::size_t n = 0; n < truth.size(); ++n) {
    if (verdicts[n] != PseudoVerdict::Accessible && verdicts[n] != PseudoVerdict::Blocked) continue;
    const bool accessible = verdicts[n] == PseudoVerdict::Accessible;
    result.by_verdict.add(accessible, found[n] != 0);
    result.by_truth.add(truth[n] != 0, found[n] != 0);
    result.unlike += accessible != (truth[n] != 0) ? 1 : 0;
  }
  return result;
}

void addCase(TableContext& context, const CalibrationCase& which, TableColumn column) {
  const double noise_m = which.noise_v * which.voxel_m;
  RunRequest run = column == TableColumn::Paper ? paperRun(which.scene, which.voxel_m)
                                                : productRun(which.scene, which.voxel_m, noise_m);
  run.scans.range_noise_m = noise_m;
  run.scans.frames = which.frames;
  if (run.params.change.mode != ChangeMode::Off) run.params.change.mode = context.options.change;
  run.params.backend = context.options.backend;
  run.params.threads = context.options.threads;
  const std::shared_ptr<const StoredScans> scans = context.scans.get(run.scans);

  PseudoTruthRequest request;
  request.name = which.scene;
  request.scans = scans->frames.size();
  request.read = [&scans](std::size_t scan) {
    io::ScanRecord record;
    record.points_S = scans->frames[scan].hits_S;
    record.T_W_S = scans->frames[scan].T_W_S;
    return record;
  };
  request.params = run.params;
  request.range_noise_m = noise_m;
  const ToolGeometry tool = ToolGeometry::builtin(run.tool);
  const PseudoTruthResult result = pseudoTruth(request, tool, context.options.observer);
  context.device = result.device;
  std::vector<Eigen::Vector3d> all_W;
  for (const PseudoTruthRun& judged : result.runs) {
    all_W.insert(all_W.end(), judged.positions_W.begin(), judged.positions_W.end());
  }
  const std::vector<PseudoVerdict> of_labels = verdictsOfLabels(request, tool, context.options.observer, all_W);
  auto label = of_labels.begin();
  const GroundTruth exact(scans->benchmark.scene.distance, tool, truthOptions(result.params));
  for (const PseudoTruthRun& judged : result.runs) {
    const auto truth = exact.accessible(judged.positions_W, judged.normals_W);
    const Comparison own = compared(judged.verdicts, truth, judged.found);
    const auto next_label = label + static_cast<std::ptrdiff_t>(truth.size());
    const Comparison labels = compared({label, next_label}, truth, judged.found);
    label = next_label;
    TableRow row = pseudoTruthRow(which.scene, column, which.voxel_m, judged);
    if (which.frames > 0) row.variant = std::to_string(which.frames) + " frames, " + row.variant;
    row.variant = (which.noise_v > 0 ? "sigma = 1 v, " : "no noise, ") + row.variant;
    row.more.insert(row.more.begin(), {{"exact_f1", own.by_truth.f1()},
                                       {"difference", own.difference()},
                                       {"exact_f1_of_all", compare(truth, judged.found).f1()},
                                       {"verdicts_unlike_truth_percent", own.unlikePercent()},
                                       {"difference_by_labels_of_the_dense_half", labels.difference()},
                                       {"labels_unlike_truth_percent", labels.unlikePercent()}});
    row.must_hold = own.by_truth.points() > 0 && std::abs(own.difference()) <= kMostDifference;
    context.rows.push_back(row);
  }
}

}  // namespace

TableRow pseudoTruthRow(const std::string& scene, TableColumn column, double voxel_m, const PseudoTruthRun& run) {
  TableRow row;
  row.table = "pseudo_truth";
  row.scene = scene;
  row.method = column == TableColumn::Paper ? "paper" : "product";
  row.column = column;
  row.voxel_m = voxel_m;
  row.figures = run.judged();
  char density[48];
  std::snprintf(density, sizeof density, "%.3g %% of the sparse half", 100 * run.density);
  row.variant = density;
  const double looked_at = static_cast<double>(std::max<std::size_t>(1, run.verdicts.size()));
  row.more = {{"points", static_cast<double>(run.points)},
              {"judged_percent", 100 * static_cast<double>(row.figures.points()) / looked_at},
              {"no_surface_percent", run.percentOf(PseudoVerdict::NoSurface)},
              {"undecided_percent", run.percentOf(PseudoVerdict::Undecided)}};
  return row;
}

void makePseudoTruthTable(TableContext& context) {
  for (const CalibrationCase& which : kCases) {
    for (const TableColumn column : {TableColumn::Paper, TableColumn::Product}) addCase(context, which, column);
  }
}

}  // namespace accessvdb::eval
