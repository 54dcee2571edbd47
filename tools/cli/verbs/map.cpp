// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb map: the main job, from files to files.
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/field_export.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/render.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tool_tables.h"
#include "options/map_options.h"
#include "options/region_options.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "output/report.h"
#include "output/run_summary.h"
#include "output/stop_signal.h"
#include "runs/agreement_check.h"
#include "runs/checkpoint.h"
#include "runs/first_returns.h"
#include "runs/gpu_fallback.h"
#include "runs/hashed_inputs.h"
#include "runs/map_outputs.h"
#include "runs/map_parameters.h"
#include "runs/memory_check.h"
#include "runs/plausibility.h"
#include "runs/reading_losses.h"
#include "runs/replay_log.h"
#include "runs/rolling_map.h"
#include "runs/scan_stamps.h"
#include "runs/tile_job.h"
#include "runs/tiled_map.h"
#include "runs/written_table.h"
#include "verbs/html_report.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

/// One run. Its report is always complete, so that it can be written whatever happens.
class MapRun {
 public:
  MapRun(const MapOptions& options, PlanSettings settings, Messages& messages)
      : options_(options),
        settings_(std::move(settings)),
        messages_(messages),
        outputs_(options),
        checkpoints_(options, messages) {}

  /// @return 0, or 128 + the signal that stopped it
  int run();
  /// Reports how far the run came. If it may not or cannot write, it prints nothing and leaves existing files alone.
  void reportFailure(const Failure& failure);

 private:
  void hashInput(const fs::path& path) { hashed_.add(path, report_.inputs); }
  int inTiles(const PlanSources& sources, std::int32_t chosen_voxels);
  int rolling(const PlanSources& sources);
  int work(io::ScanSequence& scans, AccessibilityField& field);
  void integrateAll(io::ScanSequence& scans, AccessibilityField& field);
  void replay(io::ScanSequence& scans, AccessibilityField& field);
  std::size_t readResumed(io::ScanSequence& scans);
  [[nodiscard]] RunProgress progress(const io::ScanSequence& scans) const;
  void countLeftOut(const io::ScanRecord& record);
  FrameStats integrate(const io::ScanRecord& record, double stamp_s, AccessibilityField& field);
  UpdateStats update(AccessibilityField& field);
  bool removeRegions(AccessibilityField& field);
  void writeFrame(const AccessibilityField& field);
  void finish(const io::ScanSequence& scans, const AccessibilityField& field);
  void writeViews(const std::vector<ToolSpec>& tools);
  void saveUnscored(const io::ScanSequence& scans, const AccessibilityField& field);

  const MapOptions& options_;
  PlanSettings settings_;
  Messages& messages_;
  MapOutputs outputs_;
  Checkpoints checkpoints_;
  RunProgress earlier_;  // scans that earlier runs added, before these ones
  std::vector<io::InputFile> pose_inputs_;
  std::size_t first_scan_input_ = 0;  // of report_.inputs
  RunReport report_;
  SceneStatistics scene_;
  HashedInputs hashed_;
  ReadingLosses losses_;
  std::optional<ReplayLog> replay_log_;
  std::uint64_t frames_ = 0;  // frames of the sequence written
  bool written_ = false;      // the field including its labels
  Clock::time_point start_ = Clock::now();
};

/// What its reader left out of a scan.
void MapRun::countLeftOut(const io::ScanRecord& record) {
  losses_.add(record);
  report_.noise_points = losses_.noise;
}

FrameStats MapRun::integrate(const io::ScanRecord& record, double stamp_s, AccessibilityField& field) {
  const std::vector<std::int32_t> attributes = io::attributesFor(record, field.params().carry.size());
  const FrameStats stats = record.points_W.empty()
                               ? field.integrateScan(record.points_S, record.T_W_S, stamp_s, attributes)
                               : field.integrateRays(record.points_W, record.origins_W, stamp_s, attributes);
  report_.addScan(stats, options_.mirror_distance);
  countLeftOut(record);
  ++report_.scans;
  return stats;
}

UpdateStats MapRun::update(AccessibilityField& field) {
  const UpdateStats stats = field.update();
  report_.update.add(stats.update_ms);
  report_.score.add(stats.score_ms);
  return stats;
}

/// After the last checkpoint, which is of the scans alone. @return whether there was anything to remove
bool MapRun::removeRegions(AccessibilityField& field) {
  for (const std::string& text : options_.remove) {
    const Region region = parseRegion(text);
    const Removal removal = field.removeRegion(region, parseRemovedAs(options_.removed_as));
    report_.removals.push_back({region.inWords(), removal});
    messages_.notice("removed " + region.inWords() + " as " + name(removal.as) + ": " + std::to_string(removal.voxels) +
                     " voxels, " + std::to_string(removal.points) + " points");
  }
  return !options_.remove.empty();
}

void MapRun::writeFrame(const AccessibilityField& field) {
  report_.replaces_files = true;
  writeFieldFrame(field, fs::path(options_.out) / frameName(frames_ + 1), writeOptions(options_.exported));
  ++frames_;
  addOutputs(report_.outputs, options_.out, {frameName(frames_)});
}

void MapRun::integrateAll(io::ScanSequence& scans, AccessibilityField& field) {
  Progress progress(messages_, "fusing scans", scans.size());
  const auto due = [this](int scans_each) {
    return scans_each > 0 && report_.scans % static_cast<std::uint64_t>(scans_each) == 0;
  };
  const std::size_t first = readResumed(scans);
  const std::uint64_t before = report_.scans;
  bool fresh = before > 0;  // integrated since the last update
  bool unshown = before > 0 && frames_ * static_cast<std::uint64_t>(options_.exported.sequence) < before;  // or frame
  for (std::size_t step = first; step < scans.size() && stopSignal() == 0; ++step) {
    const io::ScanRecord record = scans.read(step);
    const auto begin = Clock::now();
    integrate(record, scans.stamp_s(step).value_or(std::numeric_limits<double>::quiet_NaN()), field);
    fresh = unshown = true;
    const bool frame_due = due(options_.exported.sequence);
    if (due(options_.update_every) || frame_due) {
      update(field);
      fresh = false;
    }
    report_.frame.add(millisecondsSince(begin));
    scene_.add(record);
    if (frame_due) {
      writeFrame(field);
      unshown = false;
    }
    hashInput(record.path);
    progress.show(step + 1, fs::path(record.path).filename().string());
    if (checkpoints_.due()) checkpoints_.write(field, this->progress(scans));
  }
  progress.finish();
  if (report_.scans > before) checkpoints_.write(field, this->progress(scans));
  if (stopSignal() == 0 && removeRegions(field)) fresh = true;
  if (fresh) {
    if (!messages_.quiet() && options_.update_every == 0) messages_.notice("scoring the surface points");
    update(field);
  }
  // The last frame of the sequence has the same content as field.vdb.
  if (options_.exported.sequence > 0 && unshown && report_.points_used > 0) writeFrame(field);
}

/// What a live map did with these scans, in the same order and with the same budgets.
void MapRun::replay(io::ScanSequence& scans, AccessibilityField& field) {
  using What = ReplayLog::Row::What;
  const std::vector<ReplayLog::Row>& rows = replay_log_->rows();
  Progress progress(messages_, "replaying", rows.size());
  bool fresh = false;
  std::uint64_t points = 0;
  for (std::size_t n = 0; n < rows.size() && stopSignal() == 0; ++n) {
    const ReplayLog::Row& row = rows[n];
    if (row.what == What::StopGrowing) {
      field.stopGrowing();
      continue;
    }
    const auto begin = Clock::now();
    if (row.what == What::Scan) {
      const io::ScanRecord record = scans.read(row.step);
      points = integrate(record, row.stamp_s(), field).surface_points;
      fresh = true;
      scene_.add(record);
      hashInput(record.path);
      progress.show(n + 1, fs::path(record.path).filename().string());
    }
    std::optional<UpdateStats> updated;
    if (row.update) {
      field.setBudgetPoints(row.update->budget_points);
      updated = update(field);
      fresh = updated->backlog > 0;
    }
    replay_log_->requireSame(row, points, updated);
    report_.frame.add(millisecondsSince(begin));
  }
  progress.finish();
  field.setBudgetPoints(0);
  if (stopSignal() == 0 && removeRegions(field)) fresh = true;
  if (fresh) update(field);
}

RunProgress MapRun::progress(const io::ScanSequence& scans) const {
  RunProgress now = earlier_;
  now.next_step = report_.scans - earlier_.earlier_scans;
  now.steps = scans.size();
  now.points_in = report_.points_in;
  now.points_used = report_.points_used;
  now.dropped = report_.dropped;
  now.frames = frames_;
  now.poses = pose_inputs_;
  now.scans.assign(report_.inputs.begin() + static_cast<std::ptrdiff_t>(first_scan_input_), report_.inputs.end());
  return now;
}

/// Reads those of the scans that are in the field of --resume already: they have to be the same ones, and the warnings
/// at the end look at all scans. @return their number; 0 if these are others, to be added
std::size_t MapRun::readResumed(io::ScanSequence& scans) {
  if (!checkpoints_.resumed()) return 0;
  const RunProgress& before = *checkpoints_.resumed();
  std::vector<std::string> paths = scans.paths();
  std::erase_if(paths, [this](const std::string& path) { return hashed_.has(path); });  // poses
  const bool others = checkpoints_.addsOtherScans(paths);
  earlier_ = others ? before.followedByOthers() : before.startOfTheseScans();
  report_.inputs.insert(report_.inputs.end(), earlier_.earlier.begin(), earlier_.earlier.end());
  first_scan_input_ = report_.inputs.size();
  const std::size_t first = others ? 0 : before.next_step;
  if (!others) {
    checkpoints_.requireSameReading(scans.size());
    for (std::size_t step = 0; step < first && stopSignal() == 0; ++step) {
      const io::ScanRecord record = scans.read(step);
      scene_.add(record);
      countLeftOut(record);
      hashInput(record.path);
    }
    if (stopSignal() == 0) checkpoints_.requireSameInputs(progress(scans));
  }
  report_.scans = before.scansFused();
  report_.resumed_after_scans = report_.scans;
  report_.points_in = before.points_in;
  report_.points_used = before.points_used;
  report_.dropped = before.dropped;
  frames_ = before.frames;
  for (OutputEntry& output : withEarlier({}, options_.out)) {
    const bool frame = output.name.starts_with("field_") && output.name != "field_points.vdb";
    if (frame && frames_ > 0) report_.outputs.push_back(std::move(output));
  }
  messages_.notice(others
                       ? "adding " + std::to_string(scans.size()) + " scans to " + std::to_string(report_.scans)
                       : "going on after " + std::to_string(first) + " of " + std::to_string(scans.size()) + " scans");
  return first;
}

void MapRun::finish(const io::ScanSequence& scans, const AccessibilityField& field) {
  const fs::path out = options_.out;
  if (stopSignal() == 0) {
    for (const std::string& path : scans.paths()) hashInput(path);
  }
  const auto points = field.points();
  const Eigen::AlignedBox3d surface_W = countPoints(report_, field.memoryUse(), *points);
  losses_.say(scans, messages_);
  sayWhatBecameOfGpu(field, report_, messages_);

  io::WriteOptions files = writeOptions(options_.exported);
  files.frame = scans.frame();
  std::uint64_t full_bytes = 0;
  if (files.half_float) files.full_bytes = &full_bytes;
  report_.replaces_files = true;
  writeField(field, out, files);
  if (files.half_float) messages_.notice(savingOfHalf(fs::file_size(out / "field.vdb"), full_bytes));
  written_ = true;
  addOutputs(report_.outputs, out, fieldFilesOf(options_.exported));
  io::renderField(out / "preview.png", *points, renderOptions(options_.picture));
  addOutputs(report_.outputs, out, {"preview.png"});

  RunFacts facts{report_, scene_, surface_W, field.origin_W(), points->voxel_size_m()};
  facts.tool_size_m = (field.tool().max_T() - field.tool().min_T()).cast<double>();
  facts.tool_reach_m = field.tool().reach_m();
  facts.level_approaches = std::all_of(field.tools().begin(), field.tools().end(),
                                       [](const ToolSpec& tool) { return tool.orientations.isYaw(); });
  for (const std::string& line : summarizeRun(facts)) messages_.notice(line);
  for (const std::string& line : toolsInWords(options_, field.tools())) messages_.notice(line);
  for (const ReportedTool& tool : report_.tools) {
    messages_.notice("tool " + tool.name + " reaches " + std::to_string(tool.accessible) + " points");
  }
  for (const Warning& warning : findImplausible(facts)) messages_.warning(warning.id, warning.text);
  if (frames_ > 0) {
    messages_.notice("wrote a sequence of " + std::to_string(frames_) + " frames, " + frameName(1) + " to " +
                     frameName(frames_));
    if (lastFrameIn(out) > frames_) {
      messages_.warning("output.old_frames", (out / frameName(lastFrameIn(out))).string() + " and others after " +
                                                 frameName(frames_) + " are from an earlier run");
    }
  }
  messages_.notice("done in " + numberText(std::round(millisecondsSince(start_) / 100) / 10) +
                   " s; wrote field.vdb, field_points.vdb, " + "points.ply, preview.png and report.json into " +
                   out.string());
}

/// Saves what is left after the device failed: map and points are on the host, the labels were on the device.
void MapRun::saveUnscored(const io::ScanSequence& scans, const AccessibilityField& field) {
  if (written_ || report_.points_used == 0) return;
  const fs::path out = options_.out;
  try {
    const auto points = field.unscoredPoints();
    static_cast<void>(countPoints(report_, field.memoryUse(), *points));
    io::WriteOptions files = writeOptions(options_.exported);
    files.frame = scans.frame();
    report_.replaces_files = true;
    writeFieldUnscored(field, out, files);
    addOutputs(report_.outputs, out, fieldFilesOf(options_.exported));
    io::renderField(out / "preview.png", *points, renderOptions(options_.picture));
    addOutputs(report_.outputs, out, {"preview.png"});
    messages_.warning("device.unscored", "saved what was fused of " + std::to_string(report_.scans) + " of " +
                                             std::to_string(scans.size()) + " scans into " + out.string() +
                                             ", all points unscored: the labels were on the GPU");
  } catch (const std::exception& error) {
    messages_.warning("device.not_saved", std::string("what was fused could not be saved: ") + error.what());
  }
}

int MapRun::run() {
  checkMapOptions(options_);
  report_.parameters = reportedParameters(options_, fieldParams(options_));
  if (wantedTile_m(options_) > 0) requireTilesPossible(options_, fieldParams(options_));
  if (!options_.rolling.empty()) requireRollingPossible(options_, fieldParams(options_));
  requireReplayPossible(options_);
  outputs_.claim();
  requireGpuAskedFor(fieldParams(options_).backend);
  if (options_.rolling.empty()) checkpoints_.prepare();
  watchStopSignals();

  const std::vector<ToolSpec> tools = loadTools(options_);
  for (const std::string& path : valuesOf(options_.tool.tool)) hashInput(path);
  sayToolsNotes(options_, tools, messages_);
  requireClosedTools(options_, tools);
  io::ScanSequence scans = io::ScanSequence::open(scanInputOptions(options_));
  for (const fs::path path : {options_.poses, options_.calib, options_.survey.trajectory, options_.survey.stations}) {
    const std::size_t before = report_.inputs.size();
    hashInput(path);
    pose_inputs_.insert(pose_inputs_.end(), report_.inputs.begin() + static_cast<std::ptrdiff_t>(before),
                        report_.inputs.end());
  }
  hashInput(options_.common.config);
  if (!options_.replay_log.empty()) {
    replay_log_.emplace(options_.replay_log);
    replay_log_->match(scans);
    hashInput(options_.replay_log);
  }
  first_scan_input_ = report_.inputs.size();
  outputs_.check(inputsWith(options_, scans));
  sayAboutScans(scans, messages_);
  if (scans.deskews()) checkpoints_.readAs("deskewed", "true");
  checkpoints_.readIn(scans.frame());

  FieldParams params = fieldParams(options_, scans.recordedRangeNoise_m());
  addFirstReturns(scans.frame(), params);
  FieldParams of_field = params;  // a plan has them as they were given
  of_field.approach.rolls = rollsOf(tools.front().tool, params.approach);
  report_.parameters = reportedParameters(options_, of_field, tools);
  sayChangeNotes(params, messages_);
  requireStamps(options_, params, scans, messages_);
  report_.agreement = checkAgreement(options_, params.tsdf.range_noise_m, scans, messages_);
  report_.tools = reportedTools(options_, tools);
  const PlanSources sources = {options_, settings_, tools, scans, params};
  if (!options_.rolling.empty()) return rolling(sources);
  const bool goes_on = options_.tiles == "auto" && !options_.fresh && tiles::hasPlan(options_.out);
  if (wantedTile_m(options_) > 0 || goes_on) return inTiles(sources, 0);
  std::function<tiles::TileMargins()> margins;
  if (options_.tiles == "auto" && !whyNotInTiles(options_, params)) {
    margins = [&] { return tiles::tileMargins(tools, params, tableProgress(messages_)); };
  }
  const auto memory =
      checkMemory(options_, tools, options_.exported.surface ? RunOutput::FieldWithSurface : RunOutput::Field, scans,
                  margins, messages_);
  if (memory) report_.predicted_bytes = memory->predicted_bytes;
  if (memory && memory->tile_voxels > 0) return inTiles(sources, memory->tile_voxels);
  AccessibilityField field = checkpoints_.resumed() ? checkpoints_.load(tools, of_field)
                                                    : AccessibilityField(tools, of_field, tableProgress(messages_));
  requireShownTools(options_, tools, field.params(), field.toolShareHidden(), messages_);
  for (std::size_t k = 0; k < report_.tools.size(); ++k) report_.tools[k].collision_limit = field.collisionLimit(k);
  report_.device = field.deviceName();
  report_.device_note_id = field.deviceNoteId();
  report_.device_note = field.deviceNote();
  sayWhyNotOnGpu(field, messages_);
  sayWhatNeedsGpu(options_, &field, messages_);
  outputs_.startOver();  // only now: nothing is deleted for what is refused
  try {
    return work(scans, field);
  } catch (const Error& error) {
    // Out of memory or lost; the caller reports the error itself.
    sayWhatBecameOfGpu(field, report_, messages_);
    if (error.subject() == "cuda") saveUnscored(scans, field);
    throw;
  }
}

int MapRun::inTiles(const PlanSources& sources, std::int32_t chosen_voxels) {
  sayWhatNeedsGpu(options_, nullptr, messages_);
  requireNoInputsInTiles(options_.out, inputsWith(options_, sources.scans));
  const int exit_code = mapInTiles(sources, chosen_voxels, report_, messages_);
  writeReport(fs::path(options_.out) / "report.json", report_, messages_);
  if (report_.tiles) writeViews(sources.tools);
  return exit_code;
}

int MapRun::rolling(const PlanSources& sources) {
  sayWhatNeedsGpu(options_, nullptr, messages_);
  requireNoInputsInTiles(options_.out, inputsWith(options_, sources.scans));
  outputs_.startOver();
  const int exit_code = mapRolling(sources, pose_inputs_, report_, messages_);
  writeReport(fs::path(options_.out) / "report.json", report_, messages_);
  if (report_.tiles) writeViews(sources.tools);
  return exit_code;
}

/// What is made from the files of the result, after report.json, which the page shows.
void MapRun::writeViews(const std::vector<ToolSpec>& tools) {
  if (!options_.survey.carry.empty()) {
    writeTable(options_.out, messages_);
  } else if (const fs::path table = fs::path(options_.out) / kTableFile; io::isThere(table)) {
    messages_.warning("output.old_table", table.string() + " is from an earlier run; --carry writes a new one");
  }
  PageSources sources;
  sources.html = fs::path(options_.out) / kPageFile;
  if (!options_.html) {
    if (io::isThere(sources.html)) {
      messages_.warning("output.old_report",
                        sources.html.string() + " is from an earlier run; --html writes a new one");
    }
    return;
  }
  sources.folder = options_.out;
  for (const ToolSpec& tool : tools) sources.tools.push_back({&tool.tool});
  writePage(sources, messages_);
}

int MapRun::work(io::ScanSequence& scans, AccessibilityField& field) {
  if (replay_log_) {
    replay(scans, field);
  } else {
    integrateAll(scans, field);
  }
  const int signal = stopSignal();
  if (signal != 0) {
    messages_.notice(std::string("stopped by ") + stopSignalName() + " after " + std::to_string(report_.scans) +
                     " of " + std::to_string(earlier_.earlier_scans + scans.size()) + " scans" +
                     (report_.points_used > 0 ? "; saving the finished part" : "; nothing to save"));
    checkpoints_.sayHowToGoOn();
  }
  if (report_.points_used > 0) {
    finish(scans, field);
  } else if (signal == 0) {
    throw UnusableInput("scans.no_returns", options_.scans,
                        "none of the " + std::to_string(report_.points_in) + " returns in " +
                            std::to_string(report_.scans) + " scans can be used (" + droppedInWords(report_) + ")",
                        "Check the scans, --min-range and --max-range");
  }
  report_.exit_code = signal == 0 ? 0 : 128 + signal;
  writeReport(fs::path(options_.out) / "report.json", report_, messages_);
  if (report_.points_used > 0) writeViews(field.tools());
  return report_.exit_code;
}

void MapRun::reportFailure(const Failure& failure) {
  // The folder stays as it was, without a report.
  if (failure.id == "output.is_input" || failure.id == "output.foreign" || failure.id == "usage.rolling") return;
  if (!options_.out.empty() && !outputs_.refused())
    writeFailure(options_.out, options_.no_clobber, report_, failure, messages_);
}

}  // namespace

int runMap(const Arguments& arguments, Messages& messages) {
  MapOptions options;
  FlagParser flags;
  addMapOptions(flags, options);
  if (!parseCommandLine(flags, arguments, options.common, messages)) return 0;
  if (options.print_config) {
    printConfig(flags, options, "accessvdb map", " (a range noise recorded next to the scans changes it)");
    return 0;
  }
  MapRun run(options, planSettings(flags), messages);
  try {
    return run.run();
  } catch (const std::exception& error) {
    run.reportFailure(describeFailure(error));
    throw;
  }
}

}  // namespace accessvdb::tools
