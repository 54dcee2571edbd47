// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live: clouds and poses over DDS in, labels out while they come; files as those of `map` at the end.
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <sstream>
#include <stdexcept>

#include "accessvdb/approaches.h"
#include "accessvdb/error.h"
#include "accessvdb/field_export.h"
#include "accessvdb/live_session.h"
#include "accessvdb/next_views.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/render.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tool_tables.h"
#include "dds/outgoing_messages.h"
#include "dds/participant.h"
#include "options/live_options.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "output/report.h"
#include "output/run_summary.h"
#include "output/scan_log.h"
#include "output/stop_signal.h"
#include "runs/agreement_check.h"
#include "runs/checkpoint.h"
#include "runs/gpu_fallback.h"
#include "runs/live_commands.h"
#include "runs/live_words.h"
#include "runs/rolling_live.h"
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
/// No further command is begun then before the next scan.
constexpr double kMostOfTurn_s = 0.05;
constexpr auto kWordsEvery = std::chrono::seconds(5);

double secondsSince(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// Why a command cannot be done.
struct Refused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// One run. Its report is always complete, so that it can be written whatever happens.
class LiveRun {
 public:
  /// @param settings  planSettings()
  LiveRun(const LiveRunOptions& options, PlanSettings settings, Messages& messages)
      : options_(options), messages_(messages), rolling_(options, std::move(settings), report_, messages) {
    forgetCounts();
  }

  /// @return 128 + the signal that stopped it
  int run();
  /// Reports how far the run came. If it may not or cannot write, it prints nothing and leaves existing files alone.
  void reportFailure(const Failure& failure);

 private:
  void claimOutputFolder();
  void setParameters(const FieldParams& params, const std::vector<ToolSpec>& tools = {});
  void receive(LiveSession& session, dds::Participant& participant, ScanLog& log);
  std::optional<LiveStep> takeStep(LiveSession& session);
  std::optional<LiveStep> takeLogged(LiveSession& session, ScanLog& log);
  void takeNext(LiveSession& session, dds::Participant& participant, ScanLog& log);
  static dds::OutgoingFrame outgoing(const LiveSession& session);
  void note(const LiveStep& step);
  void forgetCounts();
  void publishPoints(LiveSession& session, dds::Participant& participant);
  void publishStatus(const LiveSession& session, dds::Participant& participant);
  void forgetProposals(const LiveSession& session, dds::Participant& participant);
  void obey(LiveSession& session, dds::Participant& participant, ScanLog& log);
  [[nodiscard]] std::string carryOut(const LiveCommand& command, LiveSession& session, dds::Participant& participant,
                                     ScanLog& log);
  void writeFiles(const LiveSession& session);
  void finish(LiveSession& session);

  const LiveRunOptions& options_;
  Messages& messages_;
  LiveWords words_{options_, messages_};
  LiveCommands commands_;
  Checkpoints checkpoints_{options_.map, messages_};
  RunReport report_;
  RollingLive rolling_;
  Eigen::AlignedBox3d surface_W_;
  bool refused_ = false;  // existing outputs must stay
  bool said_many_ = false, said_disagree_ = false, logged_full_ = false;
  std::int64_t last_stamp_ns_ = 0;
  std::uint64_t scans_ever_ = 0;                      // resets do not count
  std::uint64_t sent_after_scans_ = 0, sent_to_ = 0;  // of the last message with all points
  Clock::time_point start_ = Clock::now();
};

void LiveRun::claimOutputFolder() {
  const fs::path out = options_.map.out;
  std::vector<std::string> files(std::begin(kOutputs), std::end(kOutputs));
  if (options_.map.exported.points_format == "las") files.emplace_back("points.las");
  if (options_.map.no_clobber) {
    for (const std::string& file : files) {
      if (!io::isTaken(out / file, ErrorCode::Output)) continue;
      refused_ = true;
      throw OutputError("output.exists", (out / file).string(), "exists, and --no-clobber was given",
                        "Choose another --out folder");
    }
  }
  if (!options_.map.rolling.empty()) {
    rolling_.prepare();
    files = {"field.json", "preview.png", "report.json"};
  }
  const Paths outputs = inFolder(out, files);
  requireNoInputs(joined(outputs, {options_.scan_log}), namedInputs(options_.map));
  requireOwn(outputs);
  io::prepareOutputFolder(out);
}

void LiveRun::setParameters(const FieldParams& params, const std::vector<ToolSpec>& tools) {
  const MapOptions& map = options_.map;
  report_.parameters = {{"cloud", options_.cloud},
                        {"odom", options_.odom},
                        {"domain", std::to_string(domainOf(options_))},
                        {"network", options_.network ? "true" : "false"},
                        {"queue", std::to_string(options_.queue)},
                        {"max_message", options_.max_message},
                        {"tool", valuesInWords(map.tool.tool)},
                        {"tool_unit", valuesInWords(map.tool.unit)},
                        {"tool_tip", valuesInWords(map.tool.tip)},
                        {"tool_axis", valuesInWords(map.tool.axis)},
                        {"tool_up", valuesInWords(map.tool.up)},
                        {"profile", map.profile},
                        {"update_every", std::to_string(map.update_every)}};
  if (options_.budget_ms > 0) report_.parameters.emplace_back("budget_ms", numberText(options_.budget_ms));
  if (!options_.imu.empty()) report_.parameters.emplace_back("imu", options_.imu);
  for (const auto& given : givenSensorOptions(map.sensor)) report_.parameters.push_back(given);
  std::istringstream lines(tools.size() > 1 ? describeTools(tools, params) : params.describe());
  for (std::string line; std::getline(lines, line);) {
    const auto space = line.find(' ');
    if (space != std::string::npos) report_.parameters.emplace_back(line.substr(0, space), line.substr(space + 1));
  }
}

void LiveRun::note(const LiveStep& step) {
  if (step.only_backlog) {
    sent_to_ = 0;  // all points are sent again
    return;
  }
  report_.add(step.fused);
  report_.integrate.add(step.fused.integrate_ms);
  report_.mirror.add(step.fused.mirror_ms);
  report_.update.add(step.scored.update_ms);
  report_.score.add(step.scored.score_ms);
  report_.frame.add(step.latency_ms - step.waited_ms);
  report_.changed_leaves.add(static_cast<double>(step.fused.changed_leaves));
  report_.mirror_bytes.add(static_cast<double>(step.fused.mirror_bytes));
  ++report_.scans;
  ++scans_ever_;
  last_stamp_ns_ = step.stamp_ns;
}

/// What is said of a map, its files and how long it took. What was given, and what came since the start, stays.
void LiveRun::forgetCounts() {
  RunReport report;
  report.device = report_.device;
  report.device_note_id = report_.device_note_id;
  report.device_note = report_.device_note;
  report.parameters = std::move(report_.parameters);
  report.inputs = std::move(report_.inputs);
  report.tools = std::move(report_.tools);
  for (ReportedTool& tool : report.tools) tool.accessible = 0;
  report.live = std::move(report_.live);
  for (StageTimes* times : {&report.frame, &report.integrate, &report.mirror, &report.update, &report.score,
                            &report.changed_leaves, &report.mirror_bytes})
    *times = StageTimes(kTimedScans);
  report_ = std::move(report);
  surface_W_.setEmpty();
}

/// Points go out in the frame of the odometry, whatever was turned level here.
dds::OutgoingFrame LiveRun::outgoing(const LiveSession& session) {
  return {session.status().world_frame, session.levelling(), session.tools().size() > 1};
}

/// Of a map in tiles, a full disk does not end the flight: that scan is dropped as failed, and blocks.
std::optional<LiveStep> LiveRun::takeStep(LiveSession& session) {
  if (session.rolling() == nullptr) return session.step();
  std::optional<LiveStep> step;
  try {
    step = session.step();
  } catch (const Error& error) {
    if (!rolling_.goesOnAfter(error)) throw;
  }
  rolling_.afterStep(session, step && !step->only_backlog);
  return step;
}

/// One scan at a time: in a flood there is always another, and status, points and words must come all the same.
/// @return its step, noted
std::optional<LiveStep> LiveRun::takeLogged(LiveSession& session, ScanLog& log) {
  std::optional<LiveStep> step = takeStep(session);
  if (step) {
    note(*step);
    const LiveStatus status = session.status();
    log.taken(*step, status.surface_points);
    if (status.memory_full && !std::exchange(logged_full_, true)) log.note(scan_log::kFull, step->stamp_ns);
  }
  return step;
}

void LiveRun::takeNext(LiveSession& session, dds::Participant& participant, ScanLog& log) {
  if (const auto step = takeLogged(session, log)) {
    if (!step->changed.empty() && participant.subscribers(dds::Output::Changes) > 0) {
      participant.publish(dds::Output::Changes, dds::cloudMessage(step->changed, step->stamp_ns, outgoing(session)));
    }
  }
  log.dropped(session.takeDropped());
}

/// All points, or those of the tiles in memory, if somebody listens and has not had them.
void LiveRun::publishPoints(LiveSession& session, dds::Participant& participant) {
  const std::uint64_t listeners = participant.subscribers(dds::Output::Points);
  const bool changed = scans_ever_ != sent_after_scans_ || listeners > sent_to_;
  sent_to_ = listeners;
  if (listeners == 0 || !changed || scans_ever_ == 0) return;
  const auto publish = [&](const SurfacePoints& points) {
    if (points.size() > kMostSentPoints) {
      if (!std::exchange(said_many_, true)) {
        messages_.warning("live.many_points", std::to_string(points.size()) +
                                                  " points are too many for one message: " + dds::kOutputTopics[0] +
                                                  " stops, " + dds::kOutputTopics[1] + " goes on");
      }
      return;
    }
    participant.publish(dds::Output::Points, dds::cloudMessage(points, last_stamp_ns_, outgoing(session)));
    sent_after_scans_ = scans_ever_;
  };
  if (RollingField* const tiles = session.rolling()) {
    const FieldSnapshot around = tiles->snapshotInMemory();
    publish(SnapshotPoints(around));
  } else {
    publish(*session.field().points());
  }
}

void LiveRun::publishStatus(const LiveSession& session, dds::Participant& participant) {
  report_.live = LiveReport{session.status()};
  for (int n = 0; n < dds::kNumInputs; ++n) {
    const dds::TopicState state = participant.state(static_cast<dds::Input>(n));
    report_.live->malformed += state.malformed;
    report_.live->lost += state.lost;
  }
  for (LiveCommandReport& page : commands_.takePages()) {
    report_.live->commands = std::move(page);
    participant.publish(dds::Output::Status, dds::textMessage(liveJson(*report_.live)));
  }
  report_.agreement = session.agreement();
  if (const auto warning = agreementWarning(*report_.agreement); warning && !std::exchange(said_disagree_, true))
    messages_.warning("poses.disagree", *warning);
  words_.tell(report_.live->status);
}

/// One after the other, each answered at once. Whoever sends ever more of them keeps neither scans nor the end waiting.
void LiveRun::obey(LiveSession& session, dds::Participant& participant, ScanLog& log) {
  const Clock::time_point began = Clock::now();
  commands_.beginTurn();
  while (stopSignal() == 0 && secondsSince(began) < kMostOfTurn_s) {
    const auto command = commands_.next();
    if (!command) break;
    try {
      commands_.answer(*command, true, carryOut(*command, session, participant, log));
    } catch (const Refused& refused) {
      commands_.answer(*command, false, refused.what());
    } catch (const Error& error) {
      if (error.code() == ErrorCode::Device || error.code() == ErrorCode::Internal) throw;
      commands_.answer(*command, false, error.what());
    }
    publishStatus(session, participant);
  }
  if (commands_.hasNews()) publishStatus(session, participant);
}

/// Of points that are written without a label.
std::string waitingInWords(const LiveStatus& status) {
  if (status.backlog == 0) return "";
  return "; " + std::to_string(status.backlog) + " wait, unscored until then";
}

/// Nobody who comes later goes where the map no longer says so.
void LiveRun::forgetProposals(const LiveSession& session, dds::Participant& participant) {
  for (const dds::Output output : {dds::Output::Approaches, dds::Output::Views})
    participant.publish(output, dds::posesMessage({}, last_stamp_ns_, outgoing(session)));
}

/// @return what was done, in words  @throws Refused, Error for what could not be done; nothing has changed then
std::string LiveRun::carryOut(const LiveCommand& command, LiveSession& session, dds::Participant& participant,
                              ScanLog& log) {
  const auto refuse = [](const std::string& why) { throw Refused(why); };
  const auto showPoints = [&](const std::vector<SurfacePoint>& changed) {
    if (!changed.empty() && participant.subscribers(dds::Output::Changes) > 0)
      participant.publish(dds::Output::Changes, dds::cloudMessage(changed, last_stamp_ns_, outgoing(session)));
    sent_to_ = 0;  // all points are sent again
  };
  switch (command.kind) {
    case LiveCommandKind::Save: {
      if (session.rolling() != nullptr) refuse("cannot be done: --rolling writes the files when the run ends");
      if (session.field().points()->size() == 0) refuse("cannot be done: there is nothing to save");
      writeFiles(session);
      const LiveStatus status = session.status();
      if (report_.live) report_.live->status = status;
      writeReport(fs::path(options_.map.out) / "report.json", report_, messages_);
      return "saved " + std::to_string(report_.surface_points) + " points into " + options_.map.out +
             waitingInWords(status);
    }
    case LiveCommandKind::Checkpoint: {
      if (RollingField* const tiles = session.rolling()) {
        if (report_.scans == 0) refuse("cannot be done: there is no scan in the map");
        rolling_.checkpoint(*tiles);
        return "checkpoint after " + std::to_string(report_.scans) + " scans in " + options_.map.rolling;
      }
      if (options_.map.checkpoint.empty()) refuse("cannot be done: the program was started without --checkpoint");
      if (report_.scans == 0) refuse("cannot be done: there is no scan in the map");
      checkpoints_.noteChange();  // what was lost may have closed something since, without a scan
      RunProgress progress;
      progress.next_step = progress.steps = report_.scans;
      progress.points_in = report_.points_in;
      progress.points_used = report_.points_used;
      if (!checkpoints_.write(session.field(), progress)) refuse("could not be done: the checkpoint cannot be written");
      return "checkpoint after " + std::to_string(report_.scans) + " scans in " + options_.map.checkpoint;
    }
    case LiveCommandKind::Reset:
      if (session.rolling() != nullptr) refuse("cannot be done with --rolling: start again with another folder");
      session.reset();
      log.note(scan_log::kChanged, last_stamp_ns_);
      forgetCounts();
      checkpoints_.noteChange();
      forgetProposals(session, participant);
      showPoints({});
      return "the map is empty";
    case LiveCommandKind::Remove: {
      if (session.rolling() != nullptr) refuse("cannot be done with --rolling");
      const LiveRemoval removal = session.removeRegion(Region::box(command.min_W, command.max_W), command.removed_as);
      log.note(scan_log::kChanged, last_stamp_ns_);
      checkpoints_.noteChange();
      forgetProposals(session, participant);
      showPoints(removal.changed);
      return "removed " + std::to_string(removal.removal.voxels) + " voxels and " +
             std::to_string(removal.removal.points) + " points as " + name(removal.removal.as);
    }
    case LiveCommandKind::Approaches: {
      if (session.rolling() != nullptr) refuse("cannot be done with --rolling");
      const std::vector<ToolSpec>& tools = session.tools();
      if (std::ranges::count_if(tools, [](const ToolSpec& tool) { return tool.tool.margin_m() == 0; }) > 1)
        refuse("cannot be done with several tools: poses do not say which tool they are for");
      // Those of before are of another map, also where there are none now.
      participant.publish(dds::Output::Approaches, dds::posesMessage({}, last_stamp_ns_, outgoing(session)));
      ApproachOptions options = command.approach;
      if (options.from_W && session.levelling())
        options.from_W = Eigen::Vector3d(*session.levelling() * *options.from_W);
      const Approaches found = approaches(session.field(), options);
      std::vector<Eigen::Isometry3d> T_WT;
      for (const ApproachTarget& target : found.targets) T_WT.push_back(target.approaches.front().contact_T_WT);
      participant.publish(dds::Output::Approaches, dds::posesMessage(T_WT, last_stamp_ns_, outgoing(session)));
      return std::to_string(T_WT.size()) + " poses in contact on " +
             dds::kOutputTopics[static_cast<int>(dds::Output::Approaches)] + ", the best first" +
             (found.targets.empty() ? "" : ": " + found.targets.front().why);
    }
    case LiveCommandKind::Views: {
      if (session.rolling() != nullptr) refuse("cannot be done with --rolling");
      participant.publish(dds::Output::Views, dds::posesMessage({}, last_stamp_ns_, outgoing(session)));
      ViewOptions options = command.view;
      if (options.from_W && session.levelling())
        options.from_W = Eigen::Vector3d(*session.levelling() * *options.from_W);
      const NextViews found = nextViews(session.field(), options);
      std::vector<Eigen::Isometry3d> T_W_S;
      for (const NextView& view : found.views) T_W_S.push_back(view.T_W_S);
      participant.publish(dds::Output::Views, dds::posesMessage(T_W_S, last_stamp_ns_, outgoing(session)));
      return std::to_string(T_W_S.size()) + " poses of the sensor on " +
             dds::kOutputTopics[static_cast<int>(dds::Output::Views)] + ", in the order in which to go there" +
             (found.views.empty() ? "" : ": the first " + found.views.front().why);
    }
    case LiveCommandKind::Pause:
    case LiveCommandKind::Resume:
      session.pause(command.kind == LiveCommandKind::Pause);
      return command.kind == LiveCommandKind::Pause ? "scans are dropped until resume" : "scans are taken";
  }
  return "";
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
    obey(session, participant, log);
    if (options_.points_every_s > 0 && due(points_at, options_.points_every_s)) publishPoints(session, participant);
    if (due(status_at, options_.status_every_s)) publishStatus(session, participant);
    if (Clock::now() - words_at < kWordsEvery) continue;
    words_at = Clock::now();
    words_.sayProgress(session.status(), participant);
  }
  // What has arrived is still taken: a few scans.
  participant.stopReceiving();
  session.endOfPoses();
  while (session.status().waiting > 0) static_cast<void>(takeLogged(session, log));
  if (const std::uint64_t backlog = session.status().backlog; backlog > 0)
    messages_.notice("scoring " + std::to_string(backlog) + " points that wait; once more Ctrl-C ends at once");
  while (takeLogged(session, log)) {  // what --update-every and --budget-ms left
  }
  log.dropped(session.takeDropped());
  log.finish(session.status().allDropped());
  publishStatus(session, participant);
}

/// Field, points and picture; what was counted goes into the report.
void LiveRun::writeFiles(const LiveSession& session) {
  const MapOptions& map = options_.map;
  const fs::path out = map.out;
  const AccessibilityField& field = session.field();
  const auto points = field.points();
  report_.outputs = {};  // of an earlier save
  surface_W_ = countPoints(report_, field.memoryUse(), *points);
  report_.replaces_files = true;
  writeField(field, out, writeOptions(map.exported));
  addOutputs(report_.outputs, out, fieldFilesOf(map.exported));
  io::renderField(out / "preview.png", *points, renderOptions(map.picture));
  addOutputs(report_.outputs, out, {"preview.png"});
}

void LiveRun::finish(LiveSession& session) {
  const MapOptions& map = options_.map;
  if (RollingField* const tiles = session.rolling()) {
    rolling_.finish(*tiles);
    messages_.notice(agreementInWords(session.agreement()));
    return;
  }
  const AccessibilityField& field = session.field();
  writeFiles(session);
  sayWhatBecameOfGpu(field, report_, messages_);
  const RunFacts facts{report_, SceneStatistics(), surface_W_, field.origin_W(), field.params().tsdf.voxel_size_m};
  for (const std::string& line : summarizeRun(facts)) messages_.notice(line);
  messages_.notice(agreementInWords(session.agreement()));
  for (const std::string& line : toolsInWords(map, field.tools())) messages_.notice(line);
  for (const ReportedTool& tool : report_.tools)
    messages_.notice("tool " + tool.name + " reaches " + std::to_string(tool.accessible) + " points");
  messages_.notice("wrote field.vdb, field_points.vdb, points.ply, preview.png and report.json into " + map.out);
}

int LiveRun::run() {
  checkLiveOptions(options_);
  FieldParams params = fieldParams(options_.map);
  setParameters(params);
  claimOutputFolder();
  if (options_.map.rolling.empty()) checkpoints_.prepare();
  watchStopSignals();
  const std::vector<ToolSpec> tools = loadTools(options_.map);
  params.approach.rolls = rollsOf(tools.front().tool, params.approach);
  setParameters(params, tools);
  std::vector<std::string> inputs = valuesOf(options_.map.tool.tool);
  inputs.push_back(options_.map.common.config);
  for (const std::string& path : inputs)
    if (io::isFile(path)) report_.inputs.push_back({path, io::sha256OfFile(path)});
  sayToolsNotes(options_.map, tools, messages_);
  requireClosedTools(options_.map, tools);
  sayChangeNotes(params, messages_);
  report_.tools = reportedTools(options_.map, tools);
  ScanLog log(options_.scan_log);
  LiveOptions of_session = sessionOptions(options_);
  if (!options_.map.rolling.empty()) rolling_.addTo(of_session);
  LiveSession session(tools, params, of_session, tableProgress(messages_));
  requireShownTools(options_.map, tools, session.params(), largestShareHidden(tools, params), messages_);
  if (session.rolling() != nullptr) {
    rolling_.begin(session);
    sayWhatNeedsGpu(options_.map, nullptr, messages_);
  } else {
    for (std::size_t k = 0; k < report_.tools.size(); ++k)
      report_.tools[k].collision_limit = session.field().collisionLimit(k);
    report_.device = session.field().deviceName();
    report_.device_note_id = session.field().deviceNoteId();
    report_.device_note = session.field().deviceNote();
    sayWhyNotOnGpu(session.field(), messages_);
    sayWhatNeedsGpu(options_.map, &session.field(), messages_);
  }
  {
    const dds::ParticipantOptions domain = participantOptions(options_);
    dds::Participant participant(
        domain,
        {[&](LiveScan scan) { session.addScan(std::move(scan)); }, [&](const LivePose& pose) { session.addPose(pose); },
         [&](const LiveTransform& transform) { session.addTransform(transform); },
         [&](const LiveImu& imu) { session.addImu(imu); }, [&](const std::string& text) { commands_.receive(text); }});
    messages_.notice("live on domain " + std::to_string(domain.domain) +
                     (domain.network ? ", all network interfaces" : ", this machine only (--network opens it)") +
                     ", waiting for " + options_.cloud + " and " + options_.odom +
                     (options_.imu.empty() ? "" : ", and turned level by what " + options_.imu + " feels at rest"));
    receive(session, participant, log);
  }
  const int signal = stopSignal();
  const bool any =
      session.rolling() != nullptr ? session.rolling()->status().points > 0 : session.field().points()->size() > 0;
  if (const std::string words = budgetInWords(report_.live->status); !words.empty()) messages_.notice(words);
  messages_.notice(std::string("stopped by ") + stopSignalName() + " after " +
                   numberText(std::round(secondsSince(start_))) + " s: " + std::to_string(scans_ever_) + " of " +
                   std::to_string(report_.live->status.published) + " scans taken" + (any ? "" : "; nothing to save"));
  if (any) finish(session);
  report_.exit_code = 128 + signal;
  writeReport(fs::path(options_.map.out) / "report.json", report_, messages_);
  return report_.exit_code;
}

void LiveRun::reportFailure(const Failure& failure) {
  if (failure.id == "output.is_input" || failure.id == "output.foreign" || failure.id == "usage.rolling") return;
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
  LiveRun run(options, planSettings(flags), messages);
  try {
    return run.run();
  } catch (const std::exception& error) {
    run.reportFailure(describeFailure(error));
    throw;
  }
}

}  // namespace accessvdb::tools
