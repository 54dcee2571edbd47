// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/rolling_map.h"

#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/rolling_field.h"
#include "options/tools_given.h"
#include "output/json_text.h"
#include "output/progress.h"
#include "output/run_summary.h"
#include "output/stop_signal.h"
#include "runs/checkpoint.h"
#include "runs/hashed_inputs.h"
#include "runs/memory_check.h"
#include "runs/progress_json.h"
#include "runs/reading_losses.h"
#include "runs/rolling_words.h"
#include "runs/tiled_map.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr const char* kTaken = "taken_sha256";  // of the note, besides the progress

std::optional<std::string> whyNotRollingMap(const MapOptions& options, const FieldParams& params) {
  if (options.tiles != "auto") return "--tiles sorts all returns first; leave it out";
  if (options.exported.sequence > 0) return "--sequence needs the whole map after each scan";
  if (!options.remove.empty()) return "--remove needs a map in one piece";
  if (!options.replay_log.empty()) return "--replay-log needs a map in one piece";
  if (!options.survey.carry.empty()) return "--carry needs a map in one piece, or --tiles";
  if (options.survey.index) return "--index needs a map in one piece, or --tiles";
  if (options.keep_rays || !options.bin_memory.empty()) return "--keep-rays and --bin-memory are for --tiles";
  if (options.fresh && !options.resume.empty()) return "--fresh deletes the result, and --resume goes on from it";
  if (options.mirror_distance) return "--mirror-distance is for maps in one piece";
  if (!options.removed_as.empty() && options.removed_as != MapOptions().removed_as)
    return "--removed-as is for --remove";
  if (params.update.policy == UpdatePolicy::Paper) return "the paper's policy gives other labels in tiles";
  return whyNotRolling(options);
}

class RollingRun {
 public:
  RollingRun(const PlanSources& sources, const std::vector<io::InputFile>& poses, RunReport& report, Messages& messages)
      : sources_(sources),
        options_(sources.options),
        poses_(poses),
        report_(report),
        messages_(messages),
        params_(sources.params),
        checkpoint_every_s_(parseDuration_s("--checkpoint-every", options_.checkpoint_every)),
        hashed_(report.inputs) {
    params_.carry.clear();            // what points.las has of first returns
    params_.mirror_distance = false;  // only for kernels of this process
    reading_ = readingOf(options_);
    if (sources.scans.deskews()) reading_["deskewed"] = "true";
  }

  int run() {
    tiles::requireOwnFolders(options_.out);
    std::tie(source_.parameters, source_.flight) = plannedSources(sources_);
    requireNames();
    requireShownTools(options_, sources_.tools, params_, largestShareHidden(sources_.tools, params_), messages_);
    RollingField field = open();
    words_.sayTiles(field.status(), params_.tsdf.voxel_size_m);
    const std::size_t first = readResumed(field);
    integrateAll(field, first);
    const int signal = stopSignal();
    if (report_.points_used > 0 && report_.scans > first) field.checkpoint(note());
    if (signal != 0) {
      messages_.notice(
          std::string("stopped by ") + stopSignalName() + " after " + std::to_string(report_.scans) + " of " +
          std::to_string(sources_.scans.size()) + " scans" +
          (report_.points_used > 0 ? "; --resume " + options_.rolling + " goes on from here" : "; nothing to save"));
    } else if (report_.points_used > 0) {
      finish(field);
    } else {
      throw UnusableInput("scans.no_returns", options_.scans,
                          "none of the " + std::to_string(report_.points_in) + " returns in " +
                              std::to_string(report_.scans) + " scans can be used (" + droppedInWords(report_) + ")",
                          "Check the scans, --min-range and --max-range");
    }
    words_.sayEnd(field.status());
    report_.exit_code = signal == 0 ? 0 : 128 + signal;
    return report_.exit_code;
  }

 private:
  /// That plan.json can be written, which is the last thing to be. @throws UnusableInput "plan.name"
  void requireNames() const {
    tiles::Plan plan;
    plan.tool_name = namesOf(sources_.tools);
    plan.flights.push_back(source_.flight);
    static_cast<void>(tiles::identified(std::move(plan)));
  }
  RollingField open() {
    const bool resumes = !options_.resume.empty() && RollingField::hasCheckpoint(options_.rolling);
    RollingOptions rolling;
    rolling.folder = options_.rolling;
    rolling.process_limit_bytes = limit_bytes_.value_or(0);
    return resumes ? RollingField::resume(sources_.tools, params_, rolling, tableProgress(messages_))
                   : RollingField(sources_.tools, params_, rolling, tableProgress(messages_));
  }

  [[nodiscard]] RunProgress progress() const {
    RunProgress now;
    now.next_step = report_.scans;
    now.steps = sources_.scans.size();
    now.points_in = report_.points_in;
    now.points_used = report_.points_used;
    now.dropped = report_.dropped;
    now.poses = poses_;
    now.scans = scans_;
    return now;
  }
  void hash(const std::string& path) { hashed_.add(path, scans_); }

  /// A scan that was read.
  void noteRead(const io::ScanRecord& record) {
    losses_.add(record);
    hash(record.path);
    taken_sha256_ = io::sha256OfScans(taken_sha256_, record);
  }

  /// Reads the scans that the field has already: they have to be the same ones. More may follow them, with poses in a
  /// longer file. @return their number
  std::size_t readResumed(const RollingField& field) {
    if (field.note().empty() && field.status().steps == 0) return 0;
    RunProgress before;
    Reading reading;
    std::string taken_sha256;
    bool of_map = true;
    try {
      const nlohmann::ordered_json json = nlohmann::ordered_json::parse(field.note());
      before = progressFrom(json);
      reading = readingFrom(json);
      json.at(kTaken).get_to(taken_sha256);
    } catch (const nlohmann::ordered_json::exception&) {
      of_map = false;
    }
    if (!of_map || before.next_step != field.status().steps || before.next_step > before.steps) {
      throw UnusableInput("rolling.changed", options_.rolling, "was not made by map: it holds other scans",
                          "Go on with what it was made by, or use another folder");
    }
    if (before.next_step < sources_.scans.size() && tiles::hasPlan(options_.out)) {  // said now, not after hours
      throw OutputError("output.foreign", options_.out, "holds the tiles of another run",
                        "Choose another folder for --out");
    }
    const ResumedProgress resumed = {before, reading, options_.resume};
    const bool more = sources_.scans.size() > before.steps;
    requireSameReading(resumed, reading_, more ? before.steps : sources_.scans.size());
    for (std::size_t step = 0; step < before.next_step && stopSignal() == 0; ++step)
      noteRead(sources_.scans.read(step));
    // With more scans, files of poses, and those that hold several scans, have grown: their scans are compared instead.
    const bool same = taken_sha256_ == taken_sha256;
    if (stopSignal() == 0 && !(more && same)) {
      RunProgress now = progress();
      if (more) now.poses = before.poses;
      requireSameInputs(resumed, now);
      if (!same) {
        refuseToResume("state.scans", options_.resume,
                       "its " + std::to_string(before.next_step) + " scans have other poses or times now");
      }
    }
    report_.scans = before.next_step;
    report_.resumed_after_scans = report_.scans;
    report_.points_in = before.points_in;
    report_.points_used = before.points_used;
    report_.dropped = before.dropped;
    messages_.notice("going on after " + std::to_string(before.next_step) + " of " +
                     std::to_string(sources_.scans.size()) + " scans");
    return before.next_step;
  }

  void integrateAll(RollingField& field, std::size_t first) {
    Progress progress(messages_, "fusing scans", sources_.scans.size());
    Clock::time_point last_checkpoint = Clock::now();
    for (std::size_t step = first; step < sources_.scans.size() && stopSignal() == 0; ++step) {
      const io::ScanRecord record = sources_.scans.read(step);
      const auto begin = Clock::now();
      const double stamp_s = sources_.scans.stamp_s(step).value_or(std::numeric_limits<double>::quiet_NaN());
      const FrameStats stats = record.points_W.empty()
                                   ? field.integrateScan(record.points_S, record.T_W_S, stamp_s)
                                   : field.integrateRays(record.points_W, record.origins_W, stamp_s);
      report_.addScan(stats, false);
      ++report_.scans;
      noteRead(record);
      if (options_.update_every > 0 && report_.scans % static_cast<std::uint64_t>(options_.update_every) == 0) {
        const UpdateStats updated = field.update();
        report_.update.add(updated.update_ms);
        report_.score.add(updated.score_ms);
      }
      report_.frame.add(1e3 * secondsSince(begin));
      words_.note(field.status());
      progress.show(step + 1, fs::path(record.path).filename().string());
      if (checkpoint_every_s_ > 0 && secondsSince(last_checkpoint) >= checkpoint_every_s_) {
        try {
          field.checkpoint(note());
        } catch (const OutputError& error) {  // the one before it is whole
          if (!std::exchange(said_failed_, true)) messages_.warning("checkpoint.failed", error.what());
        }
        last_checkpoint = Clock::now();
      }
    }
    progress.finish();
  }

  [[nodiscard]] std::string note() const {
    nlohmann::ordered_json json;
    addProgress(progress(), reading_, json);
    json[kTaken] = taken_sha256_;
    return jsonText(json, -1);
  }

  void finish(RollingField& field) {
    const std::string of_scans = note();  // without what else belongs to them
    for (const std::string& path : sources_.scans.paths()) hash(path);
    losses_.say(sources_.scans, messages_);
    if (!messages_.quiet()) messages_.notice("scoring, and writing the tiles");
    io::WriteOptions files = writeOptions(options_.exported);
    files.frame = sources_.scans.frame();
    RollingSource source = source_;
    source.inputs = report_.inputs;
    source.inputs.insert(source.inputs.end(), scans_.begin(), scans_.end());
    source.frame = sources_.scans.frame();
    source.truncated_points = losses_.truncated;
    writeRolling(field, options_, files, source, report_, messages_);
    field.checkpoint(of_scans);  // with the labels
  }

  const PlanSources& sources_;
  const MapOptions& options_;
  const std::vector<io::InputFile>& poses_;
  RunReport& report_;
  Messages& messages_;
  FieldParams params_;
  double checkpoint_every_s_;
  Reading reading_;
  ReadingLosses losses_;
  RollingWords words_{options_.rolling, messages_};
  std::vector<io::InputFile> scans_;
  std::string taken_sha256_;  ///< io::sha256OfScans() of those that were read
  HashedInputs hashed_;       ///< beside the scans, what the report has
  RollingSource source_;      ///< without what only the end knows
  bool said_failed_ = false;
  /// Of the process, as the run began: what the machine can give falls as the map grows.
  const std::optional<std::uint64_t> limit_bytes_ = memoryLimit(options_);
};

}  // namespace

void requireRollingPossible(const MapOptions& options, const FieldParams& params) {
  if (const auto reason = whyNotRollingMap(options, params)) {
    throw InvalidArgument("usage.rolling", "--rolling " + options.rolling, *reason,
                          "Leave that option out, or --rolling");
  }
  requireRollingFolders(options);
}

int mapRolling(const PlanSources& sources, const std::vector<io::InputFile>& poses, RunReport& report,
               Messages& messages) {
  return RollingRun(sources, poses, report, messages).run();
}

}  // namespace accessvdb::tools
