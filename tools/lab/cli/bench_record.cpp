// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bench_record.h"

#include <algorithm>
#include <array>
#include <locale>
#include <sstream>

#include "options/options.h"
#include "output/report.h"

namespace accessvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

struct Column {
  const char* name;
  double (*of)(const BenchFrame&);
};

template <auto kPart, auto kMember>
double read(const BenchFrame& frame) {
  return static_cast<double>(frame.*kPart.*kMember);
}

constexpr std::array<Column, 5> kTimes = {{
    {"frame", [](const BenchFrame& frame) { return frame.frame_ms; }},
    {"integrate", read<&BenchFrame::integration, &FrameStats::integrate_ms>},
    {"mirror", read<&BenchFrame::integration, &FrameStats::mirror_ms>},
    {"update", read<&BenchFrame::update, &UpdateStats::update_ms>},
    {"score", read<&BenchFrame::update, &UpdateStats::score_ms>},
}};

constexpr std::array<Column, 15> kCounters = {{
    {"points_used", read<&BenchFrame::integration, &FrameStats::points_used>},
    {"touched_leaves", read<&BenchFrame::integration, &FrameStats::touched_leaves>},
    {"new_leaves", read<&BenchFrame::integration, &FrameStats::new_leaves>},
    {"changed_leaves", read<&BenchFrame::integration, &FrameStats::changed_leaves>},
    {"mirror_bytes", read<&BenchFrame::integration, &FrameStats::mirror_bytes>},
    {"distance_updates", read<&BenchFrame::integration, &FrameStats::distance_updates>},
    {"cleared_updates", read<&BenchFrame::integration, &FrameStats::cleared_updates>},
    {"dirty_points", read<&BenchFrame::update, &UpdateStats::dirty_points>},
    {"scored_points", read<&BenchFrame::update, &UpdateStats::scored_points>},
    {"direction_tests", read<&BenchFrame::update, &UpdateStats::direction_tests>},
    {"label_changes", read<&BenchFrame::update, &UpdateStats::label_changes>},
    {"new_points", [](const BenchFrame& frame) { return static_cast<double>(frame.new_points); }},
    {"flipped_voxels", read<&BenchFrame::integration, &FrameStats::flipped_voxels>},
    {"moved_points", read<&BenchFrame::update, &UpdateStats::moved_points>},
    {"fused_on_device", read<&BenchFrame::integration, &FrameStats::fused_on_device>},
}};

// Present only if that mirror is kept; always the last column.
constexpr Column kDistanceTime = {"distance_mirror", read<&BenchFrame::integration, &FrameStats::distance_mirror_ms>};
constexpr std::array<Column, 2> kDistanceCounters = {{
    {"distance_leaves", read<&BenchFrame::integration, &FrameStats::distance_leaves>},
    {"distance_mirror_bytes", read<&BenchFrame::integration, &FrameStats::distance_mirror_bytes>},
}};

Json statistics(const std::vector<BenchFrame>& frames, std::size_t last, double (*of)(const BenchFrame&)) {
  StageTimes samples;
  for (std::size_t n = frames.size() - std::min(last, frames.size()); n < frames.size(); ++n)
    samples.add(of(frames[n]));
  return {{"mean", samples.mean()},
          {"p50", samples.percentile(0.50)},
          {"p95", samples.percentile(0.95)},
          {"p99", samples.percentile(0.99)},
          {"max", samples.percentile(1.0)}};
}

}  // namespace

std::uint64_t BenchRecord::surfacePointsBefore(std::size_t n) const {
  return n == 0 || frames_.empty() ? 0 : frames_[std::min(n, frames_.size()) - 1].integration.surface_points;
}

void BenchRecord::add(BenchFrame frame) {
  frame.new_points = frame.integration.surface_points - surfacePointsBefore(frames_.size());
  frames_.push_back(frame);
}

double BenchRecord::newPercent(std::size_t begin, std::size_t end) const {
  std::uint64_t used = 0;
  for (std::size_t n = begin; n < end; ++n) used += frames_[n].integration.points_used;
  const std::uint64_t added = surfacePointsBefore(end) - surfacePointsBefore(begin);
  return used == 0 ? 0 : 100 * static_cast<double>(added) / static_cast<double>(used);
}

double BenchRecord::hitsPerVoxelBefore(std::size_t n) const {
  std::uint64_t used = 0;
  for (std::size_t i = 0; i < n; ++i) used += frames_[i].integration.points_used;
  const std::uint64_t points = surfacePointsBefore(n);
  return points == 0 ? 0 : static_cast<double>(used) / static_cast<double>(points);
}

double BenchRecord::framesPerSecond(std::size_t last) const {
  const std::size_t count = std::min(last, frames_.size());
  double sum_ms = 0;
  for (std::size_t n = frames_.size() - count; n < frames_.size(); ++n) sum_ms += frames_[n].frame_ms;
  return sum_ms > 0 ? 1e3 * static_cast<double>(count) / sum_ms : 0;
}

Json BenchRecord::timing_ms(std::size_t last) const {
  Json out = Json::object();
  for (const Column& column : kTimes) out[column.name] = statistics(frames_, last, column.of);
  if (distances_) out[kDistanceTime.name] = statistics(frames_, last, kDistanceTime.of);
  return out;
}

Json BenchRecord::counters(std::size_t last) const {
  Json out = Json::object();
  for (const Column& column : kCounters) out[column.name] = statistics(frames_, last, column.of);
  for (const Column& column : kDistanceCounters) {
    if (distances_) out[column.name] = statistics(frames_, last, column.of);
  }
  return out;
}

Json BenchRecord::backlog(std::size_t last) const {
  std::uint64_t largest = 0, in_a_row = 0, longest = 0, withheld = 0;
  double percent = 0;
  for (std::size_t n = 0; n < frames_.size(); ++n) {
    const std::uint64_t left = frames_[n].update.backlog, points = frames_[n].integration.surface_points;
    in_a_row = left > 0 ? in_a_row + 1 : 0;  // counted from the first frame: it may begin before the timed part
    if (n + last < frames_.size()) continue;
    largest = std::max(largest, left);
    withheld = std::max(withheld, frames_[n].update.withheld_points);
    longest = std::max(longest, in_a_row);
    if (points > 0) percent = std::max(percent, 100 * static_cast<double>(left) / static_cast<double>(points));
  }
  return {{"largest_points", largest},
          {"largest_percent_of_points", percent},
          {"at_end_points", frames_.empty() ? 0 : frames_.back().update.backlog},
          {"largest_withheld_points", withheld},
          {"age_at_most_updates", longest}};
}

std::string BenchRecord::csv() const {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << "n";
  for (const Column& column : kTimes) out << ',' << column.name << "_ms";
  for (const Column& column : kCounters) out << ',' << column.name;
  out << ",backlog,surface_points";
  if (distances_) out << ',' << kDistanceTime.name << "_ms";
  for (const Column& column : kDistanceCounters) {
    if (distances_) out << ',' << column.name;
  }
  out << '\n';
  for (std::size_t n = 0; n < frames_.size(); ++n) {
    out << n;
    for (const Column& column : kTimes) out << ',' << numberText(column.of(frames_[n]));
    for (const Column& column : kCounters) out << ',' << static_cast<std::uint64_t>(column.of(frames_[n]));
    out << ',' << frames_[n].update.backlog << ',' << frames_[n].integration.surface_points;
    if (distances_) out << ',' << numberText(kDistanceTime.of(frames_[n]));
    for (const Column& column : kDistanceCounters) {
      if (distances_) out << ',' << static_cast<std::uint64_t>(column.of(frames_[n]));
    }
    out << '\n';
  }
  return out.str();
}

}  // namespace accessvdb::tools
