// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live: clouds and poses over DDS in, labels out while they come; files as those of `map` at the end.
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "accessvdb/error.h"
#include "accessvdb/field_export.h"
#include "accessvdb/live_session.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/render.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tool_tables.h"
#include "dds/outgoing_messages.h"
#include "dds/participant.h"
#include "options/live_options.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/report.h"
#include "output/run_summary.h"
#include "output/stop_signal.h"
#include "runs/agreement_check.h"
#include "runs/gpu_fallback.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr const char* kOutputs[] = {"field.vdb", "field_points.vdb", "points.ply", "preview.png", "report.json"};
/// Times of so many scans go into report.json, the last ones: a run may go on for days.
constexpr std::size_t kTimedScans = 10000;
/// More points are not sent as one message: 60 MB.
constexpr std::size_t kMostSentPoints = 1500000;
/// What is done about motion and frames is said so often: senders of two kinds may take turns.
constexpr int kMostChangesSaid = 5;
constexpr auto kWordsEvery = std::chrono::seconds(5);

double secondsSince(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// A line per scan: its time in nanoseconds, and "taken" or "late" (only fused) with what it took, or why it was
/// dropped.
class ScanLog {
 public:
  explicit ScanLog(const std::string& path) : path_(path) {
    if (path.empty()) return;
    out_.open(path, std::ios::trunc);
    out_ << "# stamp_ns outcome waited_ms latency_ms changed_points\n" << std::flush;
    check();
  }
  void taken(const LiveStep& step) {
    if (path_.empty()) return;
    char text[160];
    std::snprintf(text, sizeof text, "%lld %s %.3f %.3f %zu\n", static_cast<long long>(step.stamp_ns),
                  step.late ? "late" : "taken", step.waited_ms, step.latency_ms, step.changed.size());
    out_ << text << std::flush;
    check();
  }
  void dropped(const std::vector<DroppedScan>& scans) {
    if (path_.empty()) return;
    for (const DroppedScan& scan : scans) out_ << scan.stamp_ns << " " << name(scan.reason) << "\n";
    listed_ += scans.size();
    out_ << std::flush;
    check();
  }
  /// @param dropped  scans in all: in a flood, more may come at once than a session remembers
  void finish(std::uint64_t dropped) {
    if (path_.empty() || dropped == listed_) return;
    out_ << "# " << dropped - listed_ << " more were dropped; report.json counts them by reason\n" << std::flush;
    check();
  }

 private:
  void check() const {
    if (!out_) throw OutputError("output.write", path_, "cannot be written", "Check the folder and free space");
  }
  std::string path_;
  std::ofstream out_;
  std::uint64_t listed_ = 0;  ///< of the dropped scans
};

/// One run. Its report is always complete, so that it can be written whatever happens.
class LiveRun {
 public:
  LiveRun(const LiveRunOptions& options, Messages& messages) : options_(options), messages_(messages) {
    for (StageTimes* times : {&report_.frame, &report_.integrate, &report_.mirror, &report_.update, &report_.score,
                              &report_.changed_leaves, &report_.mirror_bytes})
      *times = StageTimes(kTimedScans);
  }

  /// @return 128 + the signal that stopped it
  int run();
  /// Reports how far the run came. If it may not or cannot write, it prints nothing and leaves existing files alone.
  void reportFailure(const Failure& failure);

 private:
  void claimOutputFolder();
  void setParameters(const FieldParams& params);
  void receive(LiveSession& session, dds::Participant& participant, ScanLog& log);
  void takeNext(LiveSession& session, dds::Participant& participant, ScanLog& log);
  void note(const LiveStep& step);
  void publishPoints(const LiveSession& session, dds::Participant& participant);
  void publishStatus(const LiveSession& session, dds::Participant& participant);
  void warnOfNoneTaken(const LiveStatus& status);
  void sayFrames(const LiveStatus& status);
  void say(const LiveSession& session, const dds::Participant& participant);
  void finish(const LiveSession& session);

  const LiveRunOptions& options_;
  Messages& messages_;
  RunReport report_;
  bool refused_ = false;  // existing outputs must stay
  bool said_full_ = false, said_many_ = false, said_disagree_ = false, said_far_ = false, said_unconnected_ = false;
  std::string said_motion_, said_chain_;
  int changes_said_ = 0;
  // To see when no scan is taken any more: what was dropped when the last one was, and when looked at last.
  std::uint64_t taken_before_ = 0, times_dropped_ = 0;
  std::array<std::uint64_t, kNumScanDrops> dropped_before_ = {}, dropped_last_ = {};
  std::array<bool, kNumScanDrops> said_dropped_ = {};
  std::int64_t last_stamp_ns_ = 0;
  std::uint64_t sent_after_scans_ = 0, sent_to_ = 0;  // of the last message with all points
  Clock::time_point start_ = Clock::now();
};

void LiveRun::claimOutputFolder() {
  const fs::path out = options_.map.out;
  if (options_.map.no_clobber) {
    for (const char* file : kOutputs) {
      if (!io::isTaken(out / file, ErrorCode::Output)) continue;
      refused_ = true;
      throw OutputError("output.exists", (out / file).string(), "exists, and --no-clobber was given",
                        "Choose another --out folder");
    }
  }
  const Paths outputs = inFolder(out, {std::begin(kOutputs), std::end(kOutputs)});
  requireNoInputs(joined(outputs, {options_.scan_log}), namedInputs(options_.map));
  requireOwn(outputs);
  io::prepareOutputFolder(out);
}

void LiveRun::setParameters(const FieldParams& params) {
  const MapOptions& map = options_.map;
  report_.parameters = {{"cloud", options_.cloud},
                        {"odom", options_.odom},
                        {"domain", std::to_string(domainOf(options_))},
                        {"network", options_.network ? "true" : "false"},
                        {"queue", std::to_string(options_.queue)},
                        {"max_message", options_.max_message},
                        {"tool", map.tool.tool},
                        {"tool_unit", map.tool.unit},
                        {"tool_tip", map.tool.tip},
                        {"tool_axis", map.tool.axis},
                        {"tool_up", map.tool.up},
                        {"profile", map.profile},
                        {"update_every", "1"}};
  for (const auto& given : givenSensorOptions(map.sensor)) report_.parameters.push_back(given);
  std::istringstream lines(params.describe());
  for (std::string line; std::getline(lines, line);) {
    const auto space = line.find(' ');
    if (space != std::string::npos) report_.parameters.emplace_back(line.substr(0, space), line.substr(space + 1));
  }
}

void LiveRun::note(const LiveStep& step) {
  report_.add(step.fused);
  report_.integrate.add(step.fused.integrate_ms);
  report_.mirror.add(step.fused.mirror_ms);
  report_.update.add(step.scored.update_ms);
  report_.score.add(step.scored.score_ms);
  report_.frame.add(step.latency_ms - step.waited_ms);
  report_.changed_leaves.add(static_cast<double>(step.fused.changed_leaves));
  report_.mirror_bytes.add(static_cast<double>(step.fused.mirror_bytes));
  ++report_.scans;
  last_stamp_ns_ = step.stamp_ns;
}

/// One scan at a time: in a flood there is always another, and status, points and words must come all the same.
void LiveRun::takeNext(LiveSession& session, dds::Participant& participant, ScanLog& log) {
  if (const auto step = session.step()) {
    note(*step);
    log.taken(*step);
    if (!step->changed.empty() && participant.subscribers(dds::Output::Changes) > 0) {
      participant.publish(dds::Output::Changes,
                          dds::cloudMessage(step->changed, step->stamp_ns, session.status().world_frame));
    }
  }
  log.dropped(session.takeDropped());
}

/// All points, if somebody listens and has not had them.
void LiveRun::publishPoints(const LiveSession& session, dds::Participant& participant) {
  const std::uint64_t listeners = participant.subscribers(dds::Output::Points);
  const bool changed = report_.scans != sent_after_scans_ || listeners > sent_to_;
  sent_to_ = listeners;
  if (listeners == 0 || !changed || report_.scans == 0) return;
  const auto points = session.field().points();
  if (points->size() > kMostSentPoints) {
    if (!std::exchange(said_many_, true)) {
      messages_.warning("live.many_points", std::to_string(points->size()) +
                                                " points are too many for one message: " + dds::kOutputTopics[0] +
                                                " stops, " + dds::kOutputTopics[1] + " goes on");
    }
    return;
  }
  participant.publish(dds::Output::Points, dds::cloudMessage(*points, last_stamp_ns_, session.status().world_frame));
  sent_after_scans_ = report_.scans;
}

void LiveRun::publishStatus(const LiveSession& session, dds::Participant& participant) {
  report_.live = LiveReport{session.status()};
  for (int n = 0; n < dds::kNumInputs; ++n) {
    const dds::TopicState state = participant.state(static_cast<dds::Input>(n));
    report_.live->malformed += state.malformed;
    report_.live->lost += state.lost;
  }
  participant.publish(dds::Output::Status, dds::textMessage(liveJson(*report_.live)));
  report_.agreement = session.agreement();
  if (const auto warning = agreementWarning(*report_.agreement); warning && !std::exchange(said_disagree_, true))
    messages_.warning("poses.disagree", *warning);
  warnOfNoneTaken(report_.live->status);
  sayFrames(report_.live->status);
  if (const std::string& motion = report_.live->status.motion; !motion.empty() && motion != said_motion_) {
    if (changes_said_++ < kMostChangesSaid) messages_.notice("points: " + motion);
    said_motion_ = motion;
  }
  if (report_.live->status.memory_full && !std::exchange(said_full_, true)) {
    messages_.warning("live.memory_full", "map and points take " +
                                              bytesInWords(static_cast<double>(report_.live->status.memory_bytes)) +
                                              ", the limit: the map no longer grows, and what it has no place for "
                                              "blocks; what it has is still updated");
  }
}

/// Clocks that jump, or differ: scans go on to come, and not one of them is taken. Many at once is not that: they have
/// waited for the first poses.
void LiveRun::warnOfNoneTaken(const LiveStatus& status) {
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
    messages_.warning("live.clock", "no scan of " + options_.cloud +
                                        " is taken any more: their times are not later than that of one before, so "
                                        "the sender's clock has jumped back. Start this run again once it is right");
  }
  if (many(ScanDrop::NoPose)) {
    messages_.warning("live.no_pose", "no scan of " + options_.cloud + " is taken: " + options_.odom +
                                          " has no poses around their times. Set the clocks of both senders alike, or "
                                          "give --max-gap the time between two poses");
  }
}

void LiveRun::sayFrames(const LiveStatus& status) {
  if (!status.sensor_chain.empty() && status.sensor_chain != std::exchange(said_chain_, status.sensor_chain) &&
      changes_said_++ < kMostChangesSaid)
    messages_.notice("matching: clouds are posed by " + options_.odom + " and transforms (" + status.sensor_chain +
                     ")");
  if (!status.unconnected_frame.empty() && !std::exchange(said_unconnected_, true)) {
    messages_.warning("live.frames", "clouds in frame " + printable(status.unconnected_frame.substr(0, 100)) +
                                         " are dropped: no transform connects it to what " + options_.odom +
                                         " poses. Publish it on /tf_static, or give --extrinsic");
  }
  constexpr double kFar_m = 5;  // as for recordings
  if (status.extrinsic_m > kFar_m && !std::exchange(said_far_, true)) {
    messages_.warning("poses.extrinsic", "the sensor is " + numberText(std::round(10 * status.extrinsic_m) / 10) +
                                             " m from what " + options_.odom +
                                             " poses: check that it is in metres, and the pose of the sensor on the "
                                             "platform");
  }
}

/// One line about how it goes, not kept for the report.
void LiveRun::say(const LiveSession& session, const dds::Participant& participant) {
  const LiveStatus status = session.status();
  const dds::TopicState clouds = participant.state(dds::Input::Clouds), poses = participant.state(dds::Input::Poses);
  std::string text = std::to_string(status.taken) + " of " + std::to_string(status.published) + " scans taken, " +
                     std::to_string(status.allDropped()) + " dropped, " + std::to_string(status.surface_points) +
                     " points, latency " + numberText(std::round(status.latency_p50_ms)) + " ms, p99 " +
                     numberText(std::round(status.latency_p99_ms)) + " ms";
  if (clouds.senders == 0) text += "; nobody publishes " + options_.cloud;
  if (poses.senders == 0) text += "; nobody publishes " + options_.odom;
  if (clouds.senders > 0 && clouds.received == 0 && poses.received > 0)
    text += "; nothing of " + options_.cloud + " arrives: are its messages larger than --max-message " +
            options_.max_message + "?";
  for (const auto& [topic, state] : {std::pair{options_.cloud, clouds},
                                     {options_.odom, poses},
                                     {dds::kTransformTopics[0], participant.state(dds::Input::Transforms)},
                                     {dds::kTransformTopics[1], participant.state(dds::Input::FixedTransforms)}}) {
    if (state.malformed == 0) continue;
    text += "; " + topic + ": " + std::to_string(state.malformed) + " unusable messages, the last " +
            state.last_problem.substr(0, 200);
  }
  messages_.progress(text);
}

void LiveRun::receive(LiveSession& session, dds::Participant& participant, ScanLog& log) {
  Clock::time_point points_at = start_, status_at = start_, words_at = Clock::now();
  const auto due = [](Clock::time_point& last, double every_s) {
    if (secondsSince(last) < every_s) return false;
    last = Clock::now();
    return true;
  };
  while (stopSignal() == 0) {
    for (const std::string& notice : participant.poll()) messages_.notice(notice);
    session.waitForWork(std::chrono::milliseconds(50));
    takeNext(session, participant, log);
    if (options_.points_every_s > 0 && due(points_at, options_.points_every_s)) publishPoints(session, participant);
    if (due(status_at, options_.status_every_s)) publishStatus(session, participant);
    if (Clock::now() - words_at < kWordsEvery) continue;
    words_at = Clock::now();
    say(session, participant);
  }
  // What has arrived is still taken: a few scans.
  participant.stopReceiving();
  session.endOfPoses();
  while (session.status().waiting > 0) {
    if (const auto step = session.step()) {
      note(*step);
      log.taken(*step);
    }
  }
  log.dropped(session.takeDropped());
  log.finish(session.status().allDropped());
  publishStatus(session, participant);
}

void LiveRun::finish(const LiveSession& session) {
  const MapOptions& map = options_.map;
  const fs::path out = map.out;
  const AccessibilityField& field = session.field();
  const auto points = field.points();
  RunFacts facts{report_, SceneStatistics(), countPoints(report_, field.memoryUse(), *points), field.origin_W(),
                 points->voxel_size_m()};
  writeField(field, out, writeOptions(map.exported));
  addOutputs(report_.outputs, out, fieldFilesOf(map.exported));
  io::renderField(out / "preview.png", *points, renderOptions(map.picture));
  addOutputs(report_.outputs, out, {"preview.png"});
  for (const std::string& line : summarizeRun(facts)) messages_.notice(line);
  messages_.notice(agreementInWords(session.agreement()));
  messages_.notice(toolInWords(field.tool(), map.tool));
  messages_.notice("wrote field.vdb, field_points.vdb, points.ply, preview.png and report.json into " + out.string());
}

int LiveRun::run() {
  checkLiveOptions(options_);
  FieldParams params = fieldParams(options_.map);
  setParameters(params);
  claimOutputFolder();
  watchStopSignals();
  const ToolGeometry tool = loadTool(options_.map.tool);
  params.approach.rolls = rollsOf(tool, params.approach);
  setParameters(params);
  for (const std::string& path : {options_.map.tool.tool, options_.map.common.config}) {
    if (io::isFile(path)) report_.inputs.push_back({path, io::sha256OfFile(path)});
  }
  sayToolNotes(tool, messages_);
  requireClosedTools(options_.map, onlyTool(tool, params));
  sayChangeNotes(params, messages_);
  ScanLog log(options_.scan_log);
  LiveSession session(tool, params, sessionOptions(options_));
  requireShownTools(options_.map, session.field().tools(), session.field().params(), session.field().toolShareHidden(),
                    messages_);
  report_.device = session.field().deviceName();
  report_.device_note_id = session.field().deviceNoteId();
  report_.device_note = session.field().deviceNote();
  sayWhyNotOnGpu(session.field(), messages_);
  {
    const dds::ParticipantOptions domain = participantOptions(options_);
    dds::Participant participant(domain, {[&](LiveScan scan) { session.addScan(std::move(scan)); },
                                          [&](const LivePose& pose) { session.addPose(pose); },
                                          [&](const LiveTransform& transform) { session.addTransform(transform); }});
    messages_.notice("live on domain " + std::to_string(domain.domain) +
                     (domain.network ? ", all network interfaces" : ", this machine only (--network opens it)") +
                     ", waiting for " + options_.cloud + " and " + options_.odom);
    receive(session, participant, log);
  }
  const int signal = stopSignal();
  messages_.notice(std::string("stopped by ") + stopSignalName() + " after " +
                   numberText(std::round(secondsSince(start_))) + " s: " + std::to_string(report_.scans) + " of " +
                   std::to_string(report_.live->status.published) + " scans taken" +
                   (report_.points_used > 0 ? "" : "; nothing to save"));
  if (report_.points_used > 0) finish(session);
  report_.exit_code = 128 + signal;
  writeReport(fs::path(options_.map.out) / "report.json", report_, messages_);
  return report_.exit_code;
}

void LiveRun::reportFailure(const Failure& failure) {
  if (failure.id == "output.is_input" || failure.id == "output.foreign") return;
  if (!options_.map.out.empty() && !refused_)
    writeFailure(options_.map.out, options_.map.no_clobber, report_, failure, messages_);
}

}  // namespace

int runLive(const Arguments& arguments, Messages& messages) {
  LiveRunOptions options;
  FlagParser flags;
  addLiveOptions(flags, options);
  if (!parseCommandLine(flags, arguments, options.map.common, messages)) return 0;
  if (options.map.print_config) {
    printConfig(flags, options.map, "accessvdb live");
    return 0;
  }
  LiveRun run(options, messages);
  try {
    return run.run();
  } catch (const std::exception& error) {
    run.reportFailure(describeFailure(error));
    throw;
  }
}

}  // namespace accessvdb::tools
