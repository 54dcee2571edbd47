// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/pose_matching.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>

#include "accessvdb/error.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

bool isDigit(char c) { return c >= '0' && c <= '9'; }

std::string seconds(double value) {
  char text[64];
  std::snprintf(text, sizeof(text), "%.6f s", value);
  return text;
}

std::string span(const std::vector<double>& stamps) {
  const auto [low, high] = std::minmax_element(stamps.begin(), stamps.end());
  return seconds(*low) + " to " + seconds(*high);
}

std::string describePoses(const PoseFile& poses) {
  std::string text = std::to_string(poses.poses.size()) + " poses";
  if (!poses.stamped) return text + " without time stamps";
  std::vector<double> stamps;
  for (const PoseEntry& pose : poses.poses) stamps.push_back(pose.stamp_s);
  return text + " from " + span(stamps);
}

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
  if (!stamps.empty()) return text + " from " + span(stamps);
  const auto first = fileNumber(stems.front()), last = fileNumber(stems.back());
  if (first && last) text += " numbered " + std::to_string(*first) + " to " + std::to_string(*last);
  return text;
}

MatchResult matchByNumber(const std::vector<std::uint64_t>& numbers, const PoseFile& poses) {
  std::map<std::uint64_t, const PoseEntry*> by_index;
  for (const PoseEntry& pose : poses.poses) by_index[pose.index] = &pose;
  MatchResult result;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const PoseEntry& pose = *by_index.at(numbers[i]);
    result.scans.push_back({i, pose.T_W_S, pose.stamp_s});
  }
  result.rule = "matching: file number = pose index, from 0 (" + std::to_string(numbers.size()) + " scans, " +
                std::to_string(poses.poses.size()) + " poses)";
  return result;
}

MatchResult matchByStamp(const std::vector<std::string>& stems, const std::vector<double>& stamps,
                         const PoseFile& poses, const std::string& origin) {
  MatchResult result;
  for (std::size_t i = 0; i < stamps.size(); ++i)
    if (const auto pose = interpolatePose(poses.poses, stamps[i])) result.scans.push_back({i, *pose, stamps[i]});
  if (result.scans.empty())
    throw UnusableInput("poses.no_overlap", poses.subject,
                        "no scan has a pose at its time: " + describeScans(stems, stamps) + ", " + describePoses(poses),
                        "Use poses of this recording, on the same clock");
  result.rule = "matching: " + origin + " = time stamp, poses interpolated over gaps of at most 0.2 s (" +
                std::to_string(result.scans.size()) + " of " + std::to_string(stems.size()) + " scans, " +
                std::to_string(poses.poses.size()) + " poses)";
  if (result.scans.size() < stems.size())
    result.notices.push_back("matching: " + std::to_string(stems.size() - result.scans.size()) + " of " +
                             std::to_string(stems.size()) +
                             " scans are skipped: they have no poses around them within 0.2 s");
  return result;
}

void refuseOffset(double time_offset_s) {
  if (time_offset_s != 0)
    throw InvalidArgument("usage.time_offset", "time_offset_s", "has no effect: these scans and poses have no times",
                          "Omit it, or name the scans by their times");
}

}  // namespace

std::optional<std::uint64_t> fileNumber(const std::string& stem) {
  const std::size_t last = stem.find_last_of("0123456789");
  if (last == std::string::npos) return std::nullopt;
  std::size_t first = last;
  while (first > 0 && isDigit(stem[first - 1])) --first;
  std::uint64_t number = 0;
  if (!parseCount(std::string_view(stem).substr(first, last - first + 1), number)) return std::nullopt;
  return number;
}

std::optional<double> fileStamp_s(const std::string& stem) {
  std::size_t first = stem.size();
  std::size_t points = 0;
  while (first > 0 && (isDigit(stem[first - 1]) || (stem[first - 1] == '.' && points == 0))) {
    --first;
    points += stem[first] == '.' ? 1 : 0;
  }
  const std::string_view text = std::string_view(stem).substr(first);
  double value = 0;
  if (text.size() < 3 || text.front() == '.' || text.back() == '.' || !parseNumber(text, value)) return std::nullopt;
  if (points == 1) return value;
  if (text.size() < 10 || text.front() == '0') return std::nullopt;
  if (text.size() >= 18) return value * 1e-9;
  if (text.size() >= 15) return value * 1e-6;
  if (text.size() >= 12) return value * 1e-3;
  return value;
}

Eigen::Isometry3d interpolateBetween(const Eigen::Isometry3d& before, const Eigen::Isometry3d& after, double share) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::Quaterniond(before.linear())
                      .slerp(share, Eigen::Quaterniond(after.linear()))
                      .normalized()
                      .toRotationMatrix();
  pose.translation() = (1 - share) * before.translation() + share * after.translation();
  return pose;
}

std::optional<Eigen::Isometry3d> interpolatePose(const std::vector<PoseEntry>& poses, double stamp_s) {
  const auto after = std::lower_bound(poses.begin(), poses.end(), stamp_s,
                                      [](const PoseEntry& pose, double stamp) { return pose.stamp_s < stamp; });
  if (after != poses.end() && after->stamp_s - stamp_s <= kSameStamp_s) return after->T_W_S;
  if (after == poses.begin()) return std::nullopt;
  const PoseEntry& before = *(after - 1);
  if (stamp_s - before.stamp_s <= kSameStamp_s) return before.T_W_S;
  if (after == poses.end() || !(after->stamp_s - before.stamp_s <= kMaxPoseGap_s)) return std::nullopt;
  const double share = (stamp_s - before.stamp_s) / (after->stamp_s - before.stamp_s);
  return interpolateBetween(before.T_W_S, after->T_W_S, share);
}

MatchResult matchPoses(const std::vector<std::string>& stems, const PoseFile& poses, const std::vector<double>& times,
                       const std::string& times_name, double time_offset_s) {
  std::vector<double> stamps;
  for (const std::string& stem : stems)
    if (const auto stamp = fileStamp_s(stem)) stamps.push_back(*stamp + time_offset_s);
  const bool stamped_names = stamps.size() == stems.size();
  if (!stamped_names) stamps.clear();

  const bool indexed = poses.format != PoseFormat::Tum;
  if (indexed && !(stamped_names && poses.stamped))
    if (const auto numbers = numbersOf(stems, poses.poses.size())) {
      refuseOffset(time_offset_s);
      return matchByNumber(*numbers, poses);
    }

  if (poses.stamped && stamped_names) return matchByStamp(stems, stamps, poses, "file name");

  if (poses.stamped && !times.empty()) {
    const auto numbers = numbersOf(stems, times.size());
    if (numbers || times.size() == stems.size()) {
      std::vector<double> of_scans;
      for (std::size_t i = 0; i < stems.size(); ++i)
        of_scans.push_back(times[numbers ? (*numbers)[i] : i] + time_offset_s);
      return matchByStamp(stems, of_scans, poses, "line of " + times_name);
    }
  }

  refuseOffset(time_offset_s);
  if (stems.size() == poses.poses.size()) {
    MatchResult result;
    for (std::size_t i = 0; i < stems.size(); ++i)
      result.scans.push_back({i, poses.poses[i].T_W_S, poses.poses[i].stamp_s});
    result.rule = "matching: same number of scans and poses (" + std::to_string(stems.size()) +
                  "), taken in order; neither names nor times could confirm it";
    return result;
  }
  const bool few = poses.poses.size() < stems.size();
  throw UnusableInput(
      few ? "poses.too_few" : "poses.no_match", poses.subject,
      std::string(few ? "there are fewer poses than scans" : "the poses cannot be matched to the scans") + ": " +
          describeScans(stems, stamps) + ", " + describePoses(poses),
      "Name the scans by pose index or time stamp, or put a times.txt next to them");
}

}  // namespace accessvdb::io
