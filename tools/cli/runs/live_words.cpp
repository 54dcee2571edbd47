// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/live_words.h"

#include <cmath>
#include <utility>

#include "options/options.h"

namespace accessvdb::tools {
namespace {

/// What is done about motion and frames is said so often: senders of two kinds may take turns.
constexpr int kMostChangesSaid = 5;

}  // namespace

void LiveWords::tell(const LiveStatus& status) {
  warnOfNoneTaken(status);
  warnOfAllClosed(status);
  sayFrames(status);
  if (!status.motion.empty() && status.motion != std::exchange(said_motion_, status.motion) &&
      changes_said_++ < kMostChangesSaid)
    messages_.notice("points: " + status.motion);
  if (status.memory_full && !std::exchange(said_full_, true)) {
    messages_.warning("live.memory_full", "map and points take " +
                                              bytesInWords(static_cast<double>(status.memory_bytes)) +
                                              ", the limit: the map no longer grows, and what it has no place for "
                                              "blocks; what it has is still updated");
  }
}

void LiveWords::warnOfAllClosed(const LiveStatus& status) {
  if (!status.all_closed || std::exchange(said_closed_, true)) return;
  messages_.warning("live.all_closed",
                    "more scans were lost before their poses came than can be remembered: nothing is accessible any "
                    "more, since what they saw may be anywhere. Once " +
                        options_.odom + " keeps up, send the command reset or start this run again");
}

/// Clocks that jump, or differ: scans go on to come, and not one of them is taken. Many at once is not that: they have
/// waited for the first poses.
void LiveWords::warnOfNoneTaken(const LiveStatus& status) {
  constexpr std::uint64_t kMany = 20, kTimes = 3;
  if (status.taken != taken_before_) {
    taken_before_ = status.taken;
    dropped_before_ = dropped_last_ = status.dropped;
    times_dropped_ = 0;
    return;
  }
  times_dropped_ += status.dropped != dropped_last_ ? 1 : 0;
  dropped_last_ = status.dropped;
  if (times_dropped_ < kTimes) return;
  const auto many = [&](ScanDrop reason) {
    const auto n = static_cast<std::size_t>(reason);
    return status.dropped[n] - dropped_before_[n] >= kMany && !std::exchange(said_dropped_[n], true);
  };
  if (many(ScanDrop::OutOfOrder)) {
    messages_.warning("live.clock",
                      "no scan of " + options_.cloud +
                          " is taken any more: their times are not later than that of one before, so "
                          "the sender's clock has jumped back. Once it is right, send the command reset or "
                          "start this run again");
  }
  if (many(ScanDrop::NoPose)) {
    messages_.warning("live.no_pose", "no scan of " + options_.cloud + " is taken: " + options_.odom +
                                          " has no poses around their times. Set the clocks of both senders alike, or "
                                          "give --max-gap the time between two poses");
  }
}

void LiveWords::sayFrames(const LiveStatus& status) {
  if (!status.sensor_chain.empty() && status.sensor_chain != std::exchange(said_chain_, status.sensor_chain) &&
      changes_said_++ < kMostChangesSaid)
    messages_.notice("matching: clouds are posed by " + options_.odom + " and transforms (" + status.sensor_chain +
                     ")");
  if (!status.unconnected_frame.empty() && !std::exchange(said_unconnected_, true)) {
    messages_.warning("live.frames", "clouds in frame " + printable(status.unconnected_frame.substr(0, 100)) +
                                         " are dropped: no transform connects it to what " + options_.odom +
                                         " poses. Publish it on /tf_static, or give --extrinsic");
  }
  if (!status.unconnected_imu.empty() && !std::exchange(said_imu_, true)) {
    messages_.warning("live.imu_frame", "no transform connects the frame " +
                                            printable(status.unconnected_imu.substr(0, 100)) + " of " + options_.imu +
                                            " to what " + options_.odom +
                                            " poses: it is taken to lie as that, and the map is turned by what it "
                                            "feels. Publish it on /tf_static, or give --level ROLL,PITCH");
  }
  constexpr double kFar_m = 5;  // as for recordings
  if (status.extrinsic_m > kFar_m && !std::exchange(said_far_, true)) {
    messages_.warning("poses.extrinsic", "the sensor is " + numberText(std::round(10 * status.extrinsic_m) / 10) +
                                             " m from what " + options_.odom +
                                             " poses: check that it is in metres, and the pose of the sensor on the "
                                             "platform");
  }
}

std::string budgetInWords(const LiveStatus& status) {
  if (!(status.budget_ms > 0)) return "";
  const auto rounded = [](double ms) { return numberText(std::round(ms)); };
  return "budget: " + numberText(status.budget_ms) + " ms a scan, now " + std::to_string(status.budget_points) +
         " points; at most " + std::to_string(status.backlog_max) + " points waited, none longer than " +
         rounded(status.backlog_max_ms) + " ms";
}

void LiveWords::sayProgress(const LiveStatus& status, const dds::Participant& participant) const {
  LiveInputs inputs;
  for (int n = 0; n < dds::kNumInputs; ++n)
    inputs[static_cast<std::size_t>(n)] = participant.state(static_cast<dds::Input>(n));
  messages_.progress(progressInWords(status, inputs));
}

std::string LiveWords::progressInWords(const LiveStatus& status, const LiveInputs& inputs) const {
  const auto of = [&](dds::Input input) -> const dds::TopicState& { return inputs[static_cast<std::size_t>(input)]; };
  const dds::TopicState &clouds = of(dds::Input::Clouds), &poses = of(dds::Input::Poses);
  std::string text = std::to_string(status.taken) + " of " + std::to_string(status.published) + " scans taken, " +
                     std::to_string(status.allDropped()) + " dropped, " + std::to_string(status.surface_points) +
                     " points, latency " + numberText(std::round(status.latency_p50_ms)) + " ms, p99 " +
                     numberText(std::round(status.latency_p99_ms)) + " ms";
  if (status.backlog > 0)
    text += "; " + std::to_string(status.backlog) + " points wait, " + std::to_string(status.withheld_points) +
            " of them accessible before, the oldest for " + numberText(std::round(status.backlog_ms)) + " ms";
  if (clouds.senders == 0) text += "; nobody publishes " + options_.cloud;
  if (poses.senders == 0) text += "; nobody publishes " + options_.odom;
  if (status.waits_for_level) {
    if (of(dds::Input::Imu).senders == 0) text += "; nobody publishes " + options_.imu;
    text += "; scans wait until " + options_.imu + " says what is level";
  }
  if (clouds.senders > 0 && clouds.received == 0 && poses.received > 0)
    text += "; nothing of " + options_.cloud + " arrives: are its messages larger than --max-message " +
            options_.max_message + "?";
  for (const dds::TopicState& state : inputs) {
    if (state.malformed == 0) continue;
    text += "; " + state.topic + ": " + std::to_string(state.malformed) + " unusable messages, the last " +
            state.last_problem.substr(0, 200);
  }
  return text;
}

}  // namespace accessvdb::tools
