// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/replay_log.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <span>
#include <string_view>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/live_session.h"
#include "accessvdb/program/path_facts.h"
#include "output/error_output.h"
#include "output/scan_log.h"

namespace accessvdb::tools {
namespace {

constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 28;
constexpr std::size_t kMostOfLine = 256;
constexpr std::size_t kMostShown = 60;
/// Stamps that were read as decimal seconds differ from those in nanoseconds by rounding.
constexpr double kSameStamp_s = 1e-6;

struct Line {
  std::size_t number = 0;
  std::vector<std::string_view> words;
};

std::vector<std::string_view> wordsOf(std::string_view text) {
  std::vector<std::string_view> words;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    words.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return words;
}

/// One line after the other.
class Reader {
 public:
  explicit Reader(const std::string& path) : path_(path) {}

  [[noreturn]] void refuse(std::size_t line, const std::string& problem) const {
    throw InputError("replay.damaged", path_, "line " + std::to_string(line) + " " + problem,
                     "Give the --scan-log of a run of live as it was written");
  }
  /// All of a word.
  template <typename Number>
  Number number(const Line& line, std::size_t word, Number least, Number most) const {
    const std::string_view text = line.words[word];
    Number value = 0;
    const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || rest != text.data() + text.size() || !(value >= least && value <= most))
      refuse(line.number,
             "has \"" + printable(std::string(text.substr(0, kMostShown))) + "\" where a number should be");
    return value;
  }

  /// @return nothing for scans that were dropped and changed nothing
  [[nodiscard]] std::optional<ReplayLog::Row> row(const Line& line) const {
    using What = ReplayLog::Row::What;
    if (line.words.size() < 2) refuse(line.number, "is no row of a scan log");
    ReplayLog::Row row;
    row.line = line.number;
    row.stamp_ns = number<std::int64_t>(line, 0, INT64_MIN, INT64_MAX);
    const std::string_view outcome = line.words[1];
    if (outcome == scan_log::kTaken || outcome == scan_log::kLate || outcome == scan_log::kBacklog) {
      if (line.words.size() != wordsOf(scan_log::kHeader).size() - 1) refuse(line.number, "is cut off or too long");
      row.what = outcome == scan_log::kBacklog ? What::Backlog : What::Scan;
      for (const std::size_t word : {2, 3}) (void)number<double>(line, word, 0, 1e15);
      (void)number<std::uint64_t>(line, 4, 0, UINT32_MAX);
      row.points = number<std::uint64_t>(line, 7, 0, UINT32_MAX);
      if (line.words[5] != scan_log::kNoUpdate) {
        row.update = {number<int>(line, 5, 0, 2'000'000'000), number<std::uint64_t>(line, 6, 0, UINT64_MAX)};
      } else if (line.words[6] != scan_log::kNoUpdate) {
        refuse(line.number, "has a backlog without a budget");
      }
      if (row.update.has_value() ? outcome == scan_log::kLate : outcome == scan_log::kBacklog)
        refuse(line.number,
               "contradicts itself: " + std::string(outcome) + ", and budget " + std::string(line.words[5]));
      return row;
    }
    if (line.words.size() != 2) refuse(line.number, "is too long");
    if (outcome == scan_log::kFull) {
      row.what = What::StopGrowing;
      return row;
    }
    if (outcome == scan_log::kChanged)
      throw UnusableInput("replay.lost", path_,
                          "line " + std::to_string(line.number) + ": a command changed the map, which no scan says",
                          "Use the log of a run without the commands reset and remove");
    for (int n = 0; n < kNumScanDrops; ++n) {
      const auto reason = static_cast<ScanDrop>(n);
      if (outcome != name(reason)) continue;
      if (reason == ScanDrop::QueueFull || reason == ScanDrop::Failed)
        throw UnusableInput("replay.lost", path_,
                            "line " + std::to_string(line.number) + ": a scan was dropped as " + name(reason) +
                                ", and what it saw was closed, of which the log has nothing",
                            "Use the log of a run on a machine that keeps up");
      return std::nullopt;
    }
    refuse(line.number, "has an unknown outcome \"" + printable(std::string(outcome.substr(0, kMostShown))) + "\"");
  }

 private:
  const std::string& path_;
};

}  // namespace

ReplayLog::ReplayLog(const std::string& path) : path_(path) {
  if (!io::isFile(path)) throw InputError("input.missing", path, "is no file", "Name the --scan-log of a run of live");
  const std::string text = io::contentAt(path, kMostBytes);
  const Reader reader(path_);
  std::size_t listed = 0;
  bool ended = false;
  Line line;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = text.find('\n', at);
    ++line.number;
    const std::string_view words = std::string_view(text).substr(at, end == std::string::npos ? end : end - at);
    if (end == std::string::npos) reader.refuse(line.number, "is cut off");
    at = end + 1;
    if (ended) reader.refuse(line.number, "comes after the end");
    if (words.size() > kMostOfLine) reader.refuse(line.number, "is too long");
    if (line.number == 1) {
      if (words != scan_log::kHeader) reader.refuse(1, "is not that of a scan log with budgets");
      continue;
    }
    line.words = wordsOf(words);
    if (words.starts_with(scan_log::kEnd)) {
      if (words != scan_log::kEnd + std::to_string(listed) + " rows") reader.refuse(line.number, "counts other rows");
      ended = true;
    } else if (words.starts_with("#")) {
      throw UnusableInput("replay.lost", path_, "does not list all scans that were dropped",
                          "Use the log of a run on a machine that keeps up");
    } else {
      ++listed;
      std::optional<Row> row = reader.row(line);
      if (!row) continue;
      const bool first = rows_.empty();
      if (row->what == Row::What::Scan ? !first && row->stamp_ns <= rows_.back().stamp_ns
                                       : first || row->stamp_ns != rows_.back().stamp_ns)
        reader.refuse(line.number, "is out of order");
      rows_.push_back(*row);
    }
  }
  if (!ended)
    throw InputError("replay.unfinished", path_, "has no end: it was cut off, or the run was killed",
                     "Use the log of a run that was stopped with Ctrl-C");
  if (rows_.empty())
    throw UnusableInput("replay.scans", path_, "has no scan that was taken", "Use the log of another run");
}

void ReplayLog::match(const io::ScanSequence& scans) {
  std::vector<std::pair<double, std::size_t>> steps;  // by time
  for (std::size_t step = 0; step < scans.size(); ++step) {
    const std::optional<double> stamp_s = scans.stamp_s(step);
    if (stamp_s && std::isfinite(*stamp_s)) steps.emplace_back(*stamp_s, step);
  }
  std::ranges::stable_sort(steps, {}, &std::pair<double, std::size_t>::first);
  double taken_to = -INFINITY;  // each scan is fused once
  for (Row& row : rows_) {
    if (row.what != Row::What::Scan) continue;
    auto found = std::ranges::lower_bound(steps, std::max(row.stamp_s() - kSameStamp_s, taken_to), {},
                                          &std::pair<double, std::size_t>::first);
    // The nearest: scans of two sensors may be less than that apart.
    while (found != steps.end() && std::next(found) != steps.end() &&
           std::abs(std::next(found)->first - row.stamp_s()) < std::abs(found->first - row.stamp_s()))
      ++found;
    if (found == steps.end() || found->first > row.stamp_s() + kSameStamp_s)
      throw UnusableInput("replay.scans", path_,
                          "line " + std::to_string(row.line) + ": no scan is of the time " +
                              std::to_string(row.stamp_ns) + " ns, so it is the log of other scans",
                          "Give the recording that live was fed from, and all of it");
    row.step = found->second;
    taken_to = std::nextafter(found->first, INFINITY);
  }
}

void ReplayLog::requireSame(const Row& row, std::uint64_t points, const std::optional<UpdateStats>& update) const {
  const auto differs = [&](std::uint64_t here, const std::string& what, std::uint64_t there) {
    throw UnusableInput("replay.differs", path_,
                        "line " + std::to_string(row.line) + ": here are " + std::to_string(here) + " points " + what +
                            ", and the log has " + std::to_string(there),
                        "Give the scans, tools, parameters and --device of that run");
  };
  if (points != row.points) differs(points, "in the map", row.points);
  if (update && update->backlog != row.update->backlog) differs(update->backlog, "that wait", row.update->backlog);
}

void requireReplayPossible(const MapOptions& options) {
  if (options.replay_log.empty()) return;
  const auto refuse = [](const std::string& flag, const std::string& problem) {
    throw InvalidArgument("usage.replay", flag, problem, "Leave it out, or --replay-log");
  };
  if (options.update_every != 0) refuse("--update-every", "is contradicted by --replay-log, which says when to score");
  if (options.every != 1) refuse("--every", "leaves out scans that --replay-log has");
  if (options.exported.sequence > 0) refuse("--sequence", "scores at other times than --replay-log says");
  if (!options.checkpoint.empty() || !options.resume.empty())
    refuse(options.checkpoint.empty() ? "--resume" : "--checkpoint",
           "forgets what waits in a backlog, which --replay-log needs");
}

}  // namespace accessvdb::tools
