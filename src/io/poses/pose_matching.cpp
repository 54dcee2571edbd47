// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/pose_matching.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>

#include "accessvdb/error.h"
#include "io/poses/pose_checks.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

std::string seconds(double value) {
  char text[64];
  std::snprintf(text, sizeof(text), "%.6f s", value);
  return text;
}

std::string timeSpan(const std::vector<double>& stamps) {
  const auto [low, high] = std::minmax_element(stamps.begin(), stamps.end());
  return seconds(*low) + " to " + seconds(*high);
}

std::string describePoses(const PoseFile& poses) {
  std::string text = std::to_string(poses.poses.size()) + " poses";
  if (!poses.stamped) return text + " without time stamps";
  std::vector<double> stamps;
  for (const PoseEntry& pose : poses.poses) stamps.push_back(pose.stamp_s);
  return text + " from " + timeSpan(stamps);
}

/// Numbers that poses can have: indices, or those that the pose file gives.
std::optional<std::vector<std::uint64_t>> numbersOf(const std::vector<std::string>& stems, std::uint64_t limit) {
  std::vector<std::uint64_t> numbers;
  std::set<std::uint64_t> seen;
  for (const std::string& stem : stems) {
    const auto number = fileNumber(stem);
    if (!number || *number >= limit || !seen.insert(*number).second) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::string describeScans(const std::vector<std::string>& stems, const std::vector<double>& stamps) {
  std::string text = std::to_string(stems.size()) + " scans";
  if (!stamps.empty()) return text + " from " + timeSpan(stamps);
  const auto first = fileNumber(stems.front()), last = fileNumber(stems.back());
  if (first && last) text += " numbered " + std::to_string(*first) + " to " + std::to_string(*last);
  return text;
}

void refuseOffset(double time_offset_s) {
  if (time_offset_s != 0)
    throw InvalidArgument("usage.time_offset", "time_offset_s", "has no effect: these scans and poses have no times",
                          "Omit it, or name the scans by their times");
}

void tellSkipped(std::size_t skipped, std::size_t all, const std::string& why, MatchResult& result) {
  if (skipped > 0)
    result.notices.push_back("matching: " + std::to_string(skipped) + " of " + std::to_string(all) +
                             " scans are skipped: " + why);
}

/// What is added to the numbers of all poses to get those of the scans; nothing unless there are as many.
std::optional<std::int64_t> constantShift(std::vector<std::uint64_t> of_scans, std::vector<std::uint64_t> of_poses) {
  if (of_scans.size() != of_poses.size() || of_scans.empty()) return std::nullopt;
  std::sort(of_scans.begin(), of_scans.end());
  std::sort(of_poses.begin(), of_poses.end());
  const auto shift = static_cast<std::int64_t>(of_scans[0] - of_poses[0]);
  for (std::size_t i = 1; i < of_scans.size(); ++i)
    if (static_cast<std::int64_t>(of_scans[i] - of_poses[i]) != shift) return std::nullopt;
  return shift;
}

/// Scans that count from 0 and poses that count from 1, or the reverse: pairing equal numbers would put every scan at
/// the pose of its neighbour. Any other shift has no such reason, so that nothing says which is meant.
std::int64_t shiftOfCounting(const std::vector<std::string>& stems, const std::vector<std::uint64_t>& numbers,
                             const PoseFile& poses) {
  const std::int64_t shift = constantShift(numbers, poses.numbers).value_or(0);
  if (shift == 0) return 0;
  const std::uint64_t first_scan = *std::min_element(numbers.begin(), numbers.end());
  const std::uint64_t first_pose = *std::min_element(poses.numbers.begin(), poses.numbers.end());
  if (first_scan + first_pose == 1) return shift;
  throw UnusableInput("poses.no_match", poses.subject,
                      "the numbers of the poses begin with " + std::to_string(first_pose) +
                          " and those of as many scans " + "with " + std::to_string(first_scan) + ": " +
                          describeScans(stems, {}) + ", " + describePoses(poses),
                      "Use Match::Order if they belong together in this order, or Match::Name if equal numbers do");
}

MatchResult matchByNumber(const std::vector<std::string>& stems, const std::vector<std::uint64_t>& numbers,
                          const PoseFile& poses, bool any) {
  const std::int64_t shift = any && poses.numbered ? shiftOfCounting(stems, numbers, poses) : 0;
  std::map<std::uint64_t, const PoseEntry*> by_index;
  for (const PoseEntry& pose : poses.poses) by_index[pose.index] = &pose;
  MatchResult result;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const auto pose = by_index.find(numbers[i] - static_cast<std::uint64_t>(shift));
    if (pose != by_index.end()) result.scans.push_back({i, pose->second->T_W_S, pose->second->stamp_s});
  }
  if (result.scans.empty())
    throw UnusableInput("poses.no_match", poses.subject,
                        "no scan has a pose with its number: " + describeScans(stems, {}) + ", " + describePoses(poses),
                        "Name the scans by the numbers of the poses");
  result.rule = std::string("matching: file number") +
                (shift == 1    ? " - 1"
                 : shift == -1 ? " + 1"
                               : "") +
                " = " + (poses.numbered ? "the pose's number in its file" : "pose index, from 0") + " (" +
                std::to_string(result.scans.size()) +
                (result.scans.size() < numbers.size() ? " of " + std::to_string(numbers.size()) : "") + " scans, " +
                std::to_string(poses.poses.size()) + " poses)";
  tellSkipped(numbers.size() - result.scans.size(), numbers.size(), "there is no pose of their number", result);
  if (shift != 0)
    result.notices.push_back(std::string("matching: scans count from ") +
                             (shift > 0 ? "1 and poses from 0" : "0 and poses from 1") +
                             ", and there are as many: they are taken in order. Where equal numbers belong together, "
                             "use Match::Name");
  return result;
}

std::string stemOf(const std::string& name) {
  // Paths of Windows have other separators.
  const std::size_t folder = name.find_last_of("/\\");
  return std::filesystem::path(folder == std::string::npos ? name : name.substr(folder + 1)).stem().string();
}

/// A column of names may be of something else: of a camera, of a sensor.
bool nameSome(const std::vector<std::string>& names, const std::vector<std::string>& stems) {
  const std::set<std::string> files(stems.begin(), stems.end());
  return std::any_of(names.begin(), names.end(),
                     [&](const std::string& name) { return files.contains(name) || files.contains(stemOf(name)); });
}

/// The same poses by the numbers of another column.
std::optional<PoseFile> byNumbers(const PoseFile& poses) {
  const std::set<std::uint64_t> different(poses.numbers.begin(), poses.numbers.end());
  if (!poses.numbered || different.size() != poses.numbers.size()) return std::nullopt;
  PoseFile numbered = poses;
  numbered.scan_names.clear();
  for (PoseEntry& pose : numbered.poses) pose.index = poses.numbers.at(pose.index);
  return numbered;
}

/// By the column with the files' names, without their folders and extensions; or by their numbers, if it has numbers.
MatchResult matchByName(const std::vector<std::string>& stems, const PoseFile& poses) {
  std::map<std::string, const PoseEntry*> by_name;
  std::map<std::uint64_t, const PoseEntry*> by_number;
  bool numbers = true;
  for (const PoseEntry& pose : poses.poses) {
    const std::string& name = poses.scan_names.at(pose.index);
    std::uint64_t number = 0;
    numbers = numbers && parseCount(name, number);
    by_number[number] = &pose;
    for (const std::string& key : {name, stemOf(name)}) {
      const auto [known, added] = by_name.emplace(key, &pose);
      if (!added && known->second != nullptr && !isSamePose(known->second->T_W_S, pose.T_W_S)) known->second = nullptr;
    }
  }
  MatchResult result;
  for (std::size_t i = 0; i < stems.size(); ++i) {
    const PoseEntry* pose = nullptr;
    if (const auto named = by_name.find(stems[i]); named != by_name.end()) {
      pose = named->second;
      if (pose == nullptr)
        throw UnusableInput("poses.duplicate", poses.subject,
                            "has several different poses for " + forMessage(stems[i], 64),
                            "Leave the one that belongs to the scan");
    }
    const auto number = fileNumber(stems[i]);
    if (pose == nullptr && numbers && number && by_number.contains(*number)) pose = by_number.at(*number);
    if (pose != nullptr) result.scans.push_back({i, pose->T_W_S, pose->stamp_s});
  }
  if (result.scans.empty())
    throw UnusableInput("poses.no_match", poses.subject,
                        "no scan has a name that the poses have: " + forMessage(stems.front(), 64) + ", and " +
                            forMessage(poses.scan_names.front(), 64) + " of the poses",
                        "Name the scans as the poses do");
  result.rule = "matching: file name = name in the pose file (" + std::to_string(result.scans.size()) + " of " +
                std::to_string(stems.size()) + " scans, " + std::to_string(poses.poses.size()) + " poses)";
  tellSkipped(stems.size() - result.scans.size(), stems.size(), "there is no pose of their name", result);
  return result;
}

/// A scan this far outside of the poses was not stamped by their clock.
bool isOnAnotherClock(double stamp_s, const std::vector<PoseEntry>& poses) {
  const double first_s = poses.front().stamp_s, last_s = poses.back().stamp_s;
  const double far_s = std::max(3600.0, last_s - first_s);
  return stamp_s < first_s - far_s || stamp_s > last_s + far_s;
}

/// Names that are dates may be in local time: whole quarters of an hour.
std::string adviceForClock(const FileStamps& names, const PoseFile& poses, const MatchRequest& request) {
  constexpr int kMostQuarters = 4 * 14;
  constexpr double kQuarter_s = 900;
  for (int quarters = 1; names.dates && quarters <= kMostQuarters; ++quarters) {
    for (const double offset_s : {-quarters * kQuarter_s, quarters * kQuarter_s}) {
      const auto posed = std::count_if(names.stamps_s.begin(), names.stamps_s.end(), [&](double stamp_s) {
        return interpolatePose(poses.poses, stamp_s + request.time_offset_s + offset_s, request.max_gap_s).has_value();
      });
      if (2 * static_cast<std::size_t>(posed) < names.stamps_s.size()) continue;
      char text[32];
      std::snprintf(text, sizeof text, "%.0f", request.time_offset_s + offset_s);
      return std::string("Use time_offset_s ") + text + ", if the names are in local time";
    }
  }
  // One clock began at zero, or in another century: alike spans, which begin together.
  const auto [first, last] = std::minmax_element(names.stamps_s.begin(), names.stamps_s.end());
  const double span_s = *last - *first, of_poses_s = poses.poses.back().stamp_s - poses.poses.front().stamp_s;
  if (span_s > 0 && std::abs(span_s - of_poses_s) <= 0.1 * std::max(span_s, of_poses_s)) {
    char text[64];
    std::snprintf(text, sizeof text, "%.6f", poses.poses.front().stamp_s - *first);
    std::string offset(text);
    offset.erase(std::max(offset.find_last_not_of('0') + 1, offset.find('.')));
    if (offset.back() == '.') offset.pop_back();
    return "Use time_offset_s " + offset + " if both began at the same time, or poses on the same clock";
  }
  return "Use poses of this recording, on the same clock";
}

MatchResult matchByStamp(const std::vector<std::string>& stems, const FileStamps& names, const PoseFile& poses,
                         const std::string& origin, const MatchRequest& request) {
  MatchResult result;
  std::vector<double> stamps = names.stamps_s, unposed_s;
  for (double& stamp : stamps) stamp += request.time_offset_s;
  std::vector<std::string> strange;
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    if (const auto pose = interpolatePose(poses.poses, stamps[i], request.max_gap_s)) {
      result.scans.push_back({i, *pose, stamps[i]});
    } else {
      unposed_s.push_back(stamps[i]);
      if (isOnAnotherClock(stamps[i], poses.poses)) strange.push_back(stems[i]);
    }
  }
  const std::string gaps = adviceForGaps(poses.poses, unposed_s, request.max_gap_s);
  if (result.scans.empty())
    throw UnusableInput("poses.no_overlap", poses.subject,
                        "no scan has a pose at its time: " + describeScans(stems, stamps) + ", " +
                            describePoses(poses) + (names.words.empty() ? "" : " (names are " + names.words + ")"),
                        gaps.empty() ? adviceForClock(names, poses, request) : gaps);
  const std::string gap = gapInWords(request.max_gap_s);
  result.rule = "matching: " + origin + " = time stamp" + (names.words.empty() ? "" : " (" + names.words + ")") +
                ", poses interpolated over gaps of at most " + gap + " (" + std::to_string(result.scans.size()) +
                " of " + std::to_string(stems.size()) + " scans, " + std::to_string(poses.poses.size()) + " poses)";
  tellSkipped(unposed_s.size(), stems.size(),
              "they have no poses around them within " + gap + (gaps.empty() ? "" : ". " + gaps), result);
  if (!strange.empty())
    result.warnings.push_back({"scans.skipped", std::to_string(strange.size()) + " of " + std::to_string(stems.size()) +
                                                    " scans are skipped: their times are on another clock than the "
                                                    "poses (" +
                                                    forMessage(strange.front(), 64) +
                                                    (strange.size() > 1 ? ", ..." : "") + ")"});
  return result;
}

const char* matchName(Match match) {
  return match == Match::Order ? "Order" : match == Match::Name ? "Name" : match == Match::Time ? "Time" : "Auto";
}

/// Whole numbers that are no times by themselves may be times of the poses' clock, in a unit that has to be found.
std::optional<FileStamps> stampsInUnitOf(const std::vector<std::string>& stems, const PoseFile& poses,
                                         const MatchRequest& request) {
  FileStamps best;
  std::size_t most = 0;
  constexpr std::uint64_t kLeastTime = 1'000'000;  // smaller ones are numbers, unless Match::Time insists
  std::uint64_t largest = 0;
  for (const std::string& stem : stems) largest = std::max(largest, fileNumber(stem).value_or(0));
  if (request.match != Match::Time && largest < kLeastTime) return std::nullopt;
  for (const auto& [unit_s, name] : {std::pair(1.0, "s"), std::pair(1e-3, "ms"), {1e-6, "us"}, {1e-9, "ns"}}) {
    FileStamps stamps;
    std::size_t posed = 0;
    for (const std::string& stem : stems) {
      const auto number = fileNumber(stem);
      if (!number) return std::nullopt;
      stamps.stamps_s.push_back(static_cast<double>(*number) * unit_s);
      const double stamp_s = stamps.stamps_s.back() + request.time_offset_s;
      posed += interpolatePose(poses.poses, stamp_s, request.max_gap_s) ? 1 : 0;
    }
    const auto [low, high] = std::minmax_element(stamps.stamps_s.begin(), stamps.stamps_s.end());
    constexpr double kLeastStep_s = 1e-3;  // else all scans are at the first pose
    if (*high - *low < kLeastStep_s * static_cast<double>(stems.size() - 1) || posed <= most) continue;
    most = posed;
    stamps.words = std::string("in ") + name;
    best = std::move(stamps);
  }
  if (10 * most < 9 * stems.size()) return std::nullopt;
  return best;
}

MatchResult matchInOrder(const std::vector<std::string>& stems, const PoseFile& poses, bool asked) {
  MatchResult result;
  if (stems.size() == poses.poses.size()) {
    for (std::size_t i = 0; i < stems.size(); ++i)
      result.scans.push_back({i, poses.poses[i].T_W_S, poses.poses[i].stamp_s});
  } else {  // some of the poses are none
    for (const PoseEntry& pose : poses.poses) {
      std::size_t place = pose.index;
      if (poses.numbered && poses.scan_names.empty())
        place = static_cast<std::size_t>(std::find(poses.numbers.begin(), poses.numbers.end(), pose.index) -
                                         poses.numbers.begin());
      if (place < stems.size()) result.scans.push_back({place, pose.T_W_S, pose.stamp_s});
    }
  }
  result.rule = "matching: same number of scans and poses (" + std::to_string(stems.size()) + "), taken in order" +
                (asked ? ", as Match::Order asks" : "; neither names nor times could confirm it");
  tellSkipped(stems.size() - result.scans.size(), stems.size(), "their poses are none", result);
  if (sortDifferentlyAsText(stems))
    result.notices.push_back("matching: scans are in the order of their numbers; sorted as text, " +
                             forMessage(*std::is_sorted_until(stems.begin(), stems.end()), 64) +
                             " would come earlier. Poses that were written in that order need scans with leading "
                             "zeros, or times");
  return result;
}

}  // namespace

Eigen::Isometry3d interpolateBetween(const Eigen::Isometry3d& before, const Eigen::Isometry3d& after, double share) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::Quaterniond(before.linear())
                      .slerp(share, Eigen::Quaterniond(after.linear()))
                      .normalized()
                      .toRotationMatrix();
  pose.translation() = (1 - share) * before.translation() + share * after.translation();
  return pose;
}

std::optional<Eigen::Isometry3d> interpolatePose(const std::vector<PoseEntry>& poses, double stamp_s,
                                                 double max_gap_s) {
  const auto after = std::lower_bound(poses.begin(), poses.end(), stamp_s,
                                      [](const PoseEntry& pose, double stamp) { return pose.stamp_s < stamp; });
  if (after != poses.end() && after->stamp_s - stamp_s <= kSameStamp_s) return after->T_W_S;
  if (after == poses.begin()) return std::nullopt;
  const PoseEntry& before = *(after - 1);
  if (stamp_s - before.stamp_s <= kSameStamp_s) return before.T_W_S;
  if (after == poses.end() || !bridges(after->stamp_s - before.stamp_s, max_gap_s)) return std::nullopt;
  const double share = (stamp_s - before.stamp_s) / (after->stamp_s - before.stamp_s);
  return interpolateBetween(before.T_W_S, after->T_W_S, share);
}

std::optional<double> poseGapAt_s(const std::vector<PoseEntry>& poses, double stamp_s) {
  const auto after = std::upper_bound(poses.begin(), poses.end(), stamp_s,
                                      [](double stamp, const PoseEntry& pose) { return stamp < pose.stamp_s; });
  if (after == poses.begin() || after == poses.end()) return std::nullopt;
  return after->stamp_s - (after - 1)->stamp_s;
}

std::string adviceForGaps(const std::vector<PoseEntry>& poses, const std::vector<double>& unposed_s, double max_gap_s) {
  std::vector<double> gaps_s;
  for (const double stamp : unposed_s)
    if (const auto gap_s = poseGapAt_s(poses, stamp)) gaps_s.push_back(*gap_s);
  const std::size_t inside = gaps_s.size();
  const double enough_s = sufficientGap_s(std::move(gaps_s));
  if (!(enough_s > max_gap_s)) return {};
  char value[32];
  std::snprintf(value, sizeof value, "%.2f", enough_s);
  return std::string("Use ScanInputOptions::max_gap_s ") + value + " for " + std::to_string(inside) +
         " of them, if the sensor moved evenly between poses that far apart";
}

MatchResult matchPoses(const std::vector<std::string>& stems, const PoseFile& poses, const std::vector<double>& times,
                       const std::string& times_name, const MatchRequest& request) {
  const std::optional<FileStamps> names = fileStamps(stems);
  const bool any = request.match == Match::Auto;
  std::uint64_t limit = poses.written;
  for (const PoseEntry& pose : poses.poses) limit = std::max<std::uint64_t>(limit, pose.index + 1);

  if (!poses.scan_names.empty() && (any || request.match == Match::Name)) {
    const bool some = nameSome(poses.scan_names, stems);
    if (const auto numbered = some ? std::nullopt : byNumbers(poses))
      return matchPoses(stems, *numbered, times, times_name, request);
    const bool timed = poses.stamped && (!some || names || request.time_offset_s != 0);
    if (!timed || !any) {
      refuseOffset(request.time_offset_s);
      return matchByName(stems, poses);
    }
  }

  const bool indexed = poses.format != PoseFormat::Tum || poses.numbered;
  if (request.match == Match::Name || (any && indexed && !(names && poses.stamped))) {
    // Numbers that the file gives may be of other scans, too, and of some there may be no pose.
    if (const auto numbers = numbersOf(stems, poses.numbered ? UINT64_MAX : limit)) {
      refuseOffset(request.time_offset_s);
      return matchByNumber(stems, *numbers, poses, any);
    }
  }

  const bool by_time = poses.stamped && (any || request.match == Match::Time);
  if (by_time && names) return matchByStamp(stems, *names, poses, "file name", request);

  if (by_time && !times.empty()) {
    const auto numbers = numbersOf(stems, times.size());
    if (numbers || times.size() == stems.size()) {
      FileStamps of_scans;
      for (std::size_t i = 0; i < stems.size(); ++i) of_scans.stamps_s.push_back(times[numbers ? (*numbers)[i] : i]);
      return matchByStamp(stems, of_scans, poses, "line of " + times_name, request);
    }
  }

  const bool same_number = stems.size() == poses.poses.size() || stems.size() == poses.written;
  if (by_time && (!any || !same_number))
    if (const auto scaled = stampsInUnitOf(stems, poses, request))
      return matchByStamp(stems, *scaled, poses, "file number", request);

  refuseOffset(request.time_offset_s);
  if (same_number && (any || request.match == Match::Order)) return matchInOrder(stems, poses, !any);
  const bool few = poses.poses.size() < stems.size();
  throw UnusableInput(
      few ? "poses.too_few" : "poses.no_match", poses.subject,
      std::string(few ? "there are fewer poses than scans" : "the poses cannot be matched to the scans") +
          (any ? "" : std::string(", as Match::") + matchName(request.match) + " asks") + ": " +
          describeScans(stems, names ? names->stamps_s : std::vector<double>()) + ", " + describePoses(poses),
      "Name the scans by pose index or time stamp, or put a times.txt next to them");
}

}  // namespace accessvdb::io
