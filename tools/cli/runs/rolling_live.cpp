// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/rolling_live.h"

#include <nlohmann/json.hpp>
#include <tuple>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "output/json_text.h"
#include "runs/checkpoint.h"

namespace accessvdb::tools {
namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kFrame = "live_frame";  // of the note

}  // namespace

void requireRollingPossible(const LiveRunOptions& options) {
  if (options.map.rolling.empty()) {
    if (options.map.resume.empty()) return;
    throw InvalidArgument("usage.rolling", "--resume " + options.map.resume, "is for --rolling",
                          "Add --rolling with the same folder, or leave it out");
  }
  if (const auto reason = whyNotRolling(options.map)) {
    throw InvalidArgument("usage.rolling", "--rolling " + options.map.rolling, *reason,
                          "Leave that option out, or --rolling");
  }
}

RollingLive::RollingLive(const LiveRunOptions& options, PlanSettings settings, RunReport& report, Messages& messages)
    : options_(options),
      settings_(std::move(settings)),
      report_(report),
      messages_(messages),
      words_(options.map.rolling, messages) {}

void RollingLive::prepare() {
  every_s_ = parseDuration_s("--checkpoint-every", options_.map.checkpoint_every);
  const MapOptions& map = options_.map;
  tiles::requireOwnFolders(map.out);
  requireRollingFolders(map);
  if (tiles::hasPlan(map.out))
    throw OutputError("output.foreign", map.out, "holds the tiles of another run", "Choose another folder for --out");
}

void RollingLive::addTo(LiveOptions& options) const {
  options.rolling = RollingOptions{.folder = options_.map.rolling};
  options.resume = !options_.map.resume.empty() && RollingField::hasCheckpoint(options_.map.rolling);
}

void RollingLive::begin(LiveSession& session) {
  const RollingField& field = *session.rolling();
  words_.sayTiles(field.status(), field.params().tsdf.voxel_size_m);
  if (field.note().empty() && field.status().steps == 0) return;
  const nlohmann::json saved = nlohmann::json::parse(field.note(), nullptr, false);
  if (!saved.is_object() || !saved.contains(kFrame) || !saved[kFrame].is_string()) {
    throw UnusableInput("rolling.changed", options_.map.rolling, "was not made by live: it holds other scans",
                        "Use map --rolling, or another folder");
  }
  saved[kFrame].get_to(frame_);
  saved_steps_ = field.status().steps;
  report_.scans = saved_steps_;
  report_.resumed_after_scans = saved_steps_;
  messages_.notice("going on after " + std::to_string(report_.scans) +
                   " scans, in the frame of the odometry as it was: one that was started again lies elsewhere");
}

std::string RollingLive::note() const { return jsonText(nlohmann::json{{kFrame, frame_}}, -1); }

void RollingLive::afterStep(LiveSession& session, bool taken) {
  RollingField& field = *session.rolling();
  const RollingStatus now = field.status();
  if (taken) words_.note(now);
  sayFrame(session.status().world_frame);
  if (now.unsaved) sayDisk("a tile cannot be written");
  const bool due = every_s_ > 0 && std::chrono::duration<double>(Clock::now() - last_).count() >= every_s_;
  if (due && now.steps != saved_steps_) tryCheckpoint(field);
  if (taken && !now.unsaved && (saved_steps_ == now.steps || every_s_ == 0) && std::exchange(disk_failed_, false))
    messages_.notice("the disk takes tiles again");
}

void RollingLive::sayFrame(const std::string& frame) {
  if (frame.empty()) return;
  if (!frame_.empty() && frame != frame_ && !std::exchange(said_frame_, true)) {
    messages_.warning("rolling.frame", "poses are in frame " + printable(frame.substr(0, 100)) +
                                           " now, and were in frame " + printable(frame_.substr(0, 100)) +
                                           ": what was mapped before lies elsewhere. Start with another folder");
  }
  frame_ = frame;
}

void RollingLive::tryCheckpoint(RollingField& field) {
  last_ = Clock::now();
  try {
    checkpoint(field);
  } catch (const OutputError& error) {
    if (!goesOnAfter(error)) throw;
  }
}

void RollingLive::checkpoint(RollingField& field) {
  field.checkpoint(note());
  saved_steps_ = field.status().steps;
  last_ = Clock::now();
}

void RollingLive::sayDisk(const std::string& problem) {
  constexpr int kMostSaid = 5;
  if (std::exchange(disk_failed_, true) || ++said_disk_ > kMostSaid) return;
  messages_.warning("rolling.disk", problem +
                                        "; the run goes on with the tiles that are in memory, and scans for which "
                                        "others would have to come or go are dropped, and block");
}

bool RollingLive::goesOnAfter(const Error& error) {
  if (error.code() != ErrorCode::Output && error.code() != ErrorCode::Input) return false;
  sayDisk(error.subject() + " " + error.problem());
  return true;
}

void RollingLive::finish(RollingField& field) {
  tryCheckpoint(field);
  messages_.notice("scoring, and writing the tiles");
  RollingSource source;
  std::tie(source.parameters, source.flight) = plannedLive(settings_, field.params());
  source.inputs = report_.inputs;
  writeRolling(field, options_.map, writeOptions(options_.map.exported), source, report_, messages_);
  tryCheckpoint(field);  // with the labels
  words_.sayEnd(field.status());
  if (report_.live) report_.live->status.rolling = field.status();
}

}  // namespace accessvdb::tools
