// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/run_summary.h"

#include <cstdio>

#include "accessvdb/program/memory_prediction.h"
#include "options/options.h"

namespace accessvdb::tools {
namespace {

std::string share(std::uint64_t part, std::uint64_t whole) {
  char text[64];
  std::snprintf(text, sizeof text, "%.1f %%",
                whole > 0 ? 100.0 * static_cast<double>(part) / static_cast<double>(whole) : 0.0);
  return text;
}

std::string vectorText(const Eigen::Vector3d& v) {
  char text[96];
  std::snprintf(text, sizeof text, "(%.10g, %.10g, %.10g)", v.x(), v.y(), v.z());
  return text;
}

}  // namespace

std::string droppedInWords(const RunReport& report) {
  std::string words;
  for (int i = 0; i < kNumDropReasons; ++i) {
    if (report.dropped[i] == 0) continue;
    words += (words.empty() ? "" : ", ") + std::string(name(static_cast<DropReason>(i))) + " " +
             share(report.dropped[i], report.points_in);
  }
  return words.empty() ? "none dropped" : words;
}

std::vector<std::string> summarizeRun(const RunFacts& facts) {
  const RunReport& report = facts.report;
  std::vector<std::string> lines;
  lines.push_back(std::to_string(report.scans) + " scans, " + std::to_string(report.points_in) + " returns, " +
                  share(report.points_used, report.points_in) + " used; dropped: " + droppedInWords(report));
  if (const auto notice = openSkyNotice(report)) lines.push_back(*notice);
  std::string labels = std::to_string(report.surface_points) + " surface points";
  // With --points surface, those beside it are no places of their own.
  const std::uint64_t beside = report.reasons[static_cast<int>(PointReason::BesideSurface)];
  if (beside > 0) labels += ", " + std::to_string(beside) + " of them beside the surface; the others";
  for (const PointLabel label : {PointLabel::Accessible, PointLabel::Blocked, PointLabel::Unscored}) {
    const std::uint64_t count = report.labels[static_cast<int>(label)] - (label == PointLabel::Unscored ? beside : 0);
    labels += std::string(label == PointLabel::Accessible ? ": " : ", ") + name(label) + " " + std::to_string(count) +
              " (" + share(count, report.surface_points - beside) + ")";
  }
  lines.push_back(labels);
  std::string reasons;
  for (int i = 1; i < kNumPointReasons; ++i) {
    if (report.reasons[i] == 0) continue;
    reasons += (reasons.empty() ? "not accessible because of: " : ", ") +
               std::string(name(static_cast<PointReason>(i))) + " " + std::to_string(report.reasons[i]);
  }
  if (!reasons.empty()) lines.push_back(reasons);
  if (!facts.surface_W.isEmpty()) {
    lines.push_back("surface from " + vectorText(facts.surface_W.min()) + " to " + vectorText(facts.surface_W.max()) +
                    " m, size " + vectorText(facts.surface_W.sizes()) + " m, local origin " +
                    vectorText(facts.origin_W));
  }
  lines.push_back("map: " + std::to_string(report.memory.leaves) + " leaves, " +
                  std::to_string(report.memory.active_voxels) + " observed voxels of " +
                  numberText(facts.voxel_size_m) + " m, " + bytesInWords(static_cast<double>(report.memory.map_bytes)) +
                  "; process peak " + bytesInWords(static_cast<double>(peakMemoryBytes())));
  return lines;
}

}  // namespace accessvdb::tools
