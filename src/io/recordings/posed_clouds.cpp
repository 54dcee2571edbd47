// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which clouds of a recording become steps: those with poses, each once.
#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"
#include "io/recordings/frame_names.h"
#include "io/recordings/recording_steps.h"
#include "io/recordings/stamp_words.h"

namespace accessvdb::io {

/// The same message may be in two parts of a recording, or twice in one: it counts once.
void RecordingSteps::leaveOutRepeated(std::vector<IndexedCloud>& clouds) {
  std::size_t kept = 0, repeated = 0;
  std::int64_t first_ns = 0;
  for (std::size_t i = 0; i < clouds.size(); ++i) {
    bool again = false;
    for (std::size_t k = kept; !again && k > 0 && clouds[k - 1].stamp_ns == clouds[i].stamp_ns; --k) {
      const IndexedCloud& before = clouds[k - 1];
      if (before.frame != clouds[i].frame) continue;
      const std::string bytes(recordings_[before.file]->read(before.place));
      again = bytes == recordings_[clouds[i].file]->read(clouds[i].place);
    }
    if (again && repeated++ == 0) first_ns = clouds[i].stamp_ns;
    if (!again) clouds[kept++] = clouds[i];
  }
  if (repeated == 0) return;
  warnings_.push_back({"scans.repeated", std::to_string(repeated) + " of " + std::to_string(clouds.size()) +
                                             " clouds have the same bytes as another one, and count once: first at " +
                                             secondsText(first_ns) + " s"});
  clouds.resize(kept);
}

void RecordingSteps::leaveOutStrays(IndexedTopic& cloud, bool usual_is_posed) {
  const std::string usual = *mostUsedFrame(cloud, [](const std::string&) { return false; });
  constexpr auto kNotPosed = static_cast<std::uint32_t>(-1);
  std::vector<std::uint32_t> place(cloud.frames.size());  ///< [frame] among those that are left
  std::vector<std::string> left;
  std::string stray;
  for (std::size_t frame = 0; frame < cloud.frames.size(); ++frame) {
    const std::string& name = cloud.frames[frame];
    const bool posed = usual_is_posed && ((!world_.empty() && name == world_) || plainFrame(name) == plainFrame(usual));
    const bool connected = posed || frames_.chain(world_, name).has_value();
    place[frame] = connected ? static_cast<std::uint32_t>(left.size()) : kNotPosed;
    if (connected) left.push_back(name);
    if (!connected && stray.empty()) stray = frameText(name);
  }
  const auto isStray = [&](const IndexedCloud& one) { return place[one.frame] == kNotPosed; };
  const std::size_t all = cloud.clouds.size();
  const auto strays = static_cast<std::size_t>(std::count_if(cloud.clouds.begin(), cloud.clouds.end(), isStray));
  if (left.size() == cloud.frames.size() || 2 * strays >= all) return;
  std::erase_if(cloud.clouds, isStray);
  for (IndexedCloud& one : cloud.clouds) one.frame = place[one.frame];
  cloud.frames = std::move(left);
  if (strays > 0)
    warnings_.push_back({"scans.skipped", std::to_string(strays) + " of " + std::to_string(all) + " clouds of " +
                                              wordForMessage(topic_) + " are skipped: they are in frame " + stray +
                                              ", which nothing connects to frame " + frameText(usual) +
                                              " of the others"});
}

void RecordingSteps::keepPosed(std::vector<IndexedCloud> clouds, const ScanInputOptions& options) {
  constexpr double kMostOffset_s = 4e9;
  if (!(std::abs(options.time_offset_s) <= kMostOffset_s))
    throw InvalidArgument("usage.time_offset", "time_offset_s", "is more than a century", "Use seconds");
  const auto offset_ns = static_cast<std::int64_t>(std::llround(options.time_offset_s * 1e9));
  for (IndexedCloud& cloud : clouds) cloud.stamp_ns += offset_ns;
  const auto earlier = [](const IndexedCloud& a, const IndexedCloud& b) { return a.stamp_ns < b.stamp_ns; };
  if (!std::is_sorted(clouds.begin(), clouds.end(), earlier)) {
    std::stable_sort(clouds.begin(), clouds.end(), earlier);
    notices_.push_back("recording: clouds were not recorded in the order of their times, and have been sorted");
  }
  leaveOutRepeated(clouds);
  const std::size_t all = clouds.size();
  const std::string span = spanText(clouds.front().stamp_ns, clouds.back().stamp_ns);
  std::size_t before = 0;
  bool found = false;
  std::size_t posed = 0;
  const std::string gap = gapInWords(max_gap_s_);
  std::vector<std::int64_t> unposed_ns;
  std::int64_t first_ns = 0, last_ns = 0;  // of those with poses
  for (const IndexedCloud& cloud : clouds) {
    if (!poseOf(cloud)) {
      before += found ? 0 : 1;
      unposed_ns.push_back(cloud.stamp_ns);
      continue;
    }
    if (!found) first_ns = cloud.stamp_ns;
    last_ns = cloud.stamp_ns;
    found = true;
    if (posed++ % static_cast<std::size_t>(options.every) == 0) steps_.push_back(cloud);
  }
  if (posed == 0)
    throw UnusableInput(
        "poses.no_overlap", subject_,
        "no cloud has a pose at its time: " + std::to_string(all) + " clouds from " + span + ", " + span_,
        "Use poses of this recording, on the same clock");
  rule_ += ", poses interpolated over gaps of at most " + gap + " (" + std::to_string(posed) + " of " +
           std::to_string(all) + " clouds, " + span_ + ")";
  constexpr std::int64_t kHour_ns = 3'600'000'000'000;
  const std::int64_t far_ns = std::max(kHour_ns, last_ns - first_ns);
  const auto strange = std::count_if(unposed_ns.begin(), unposed_ns.end(), [&](std::int64_t stamp_ns) {
    return stamp_ns < first_ns - far_ns || stamp_ns > last_ns + far_ns;
  });
  if (strange > 0)
    warnings_.push_back({"scans.skipped", std::to_string(strange) + " of " + std::to_string(all) +
                                              " clouds are skipped: their times are on another clock than the poses"});
  if (posed < all)
    notices_.push_back("matching: " + std::to_string(all - posed) + " of " + std::to_string(all) +
                       " clouds are skipped: they have no poses around them within " + gap + " (" +
                       std::to_string(before) + " of them before the first that has)");
}

}  // namespace accessvdb::io
