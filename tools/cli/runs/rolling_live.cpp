// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/rolling_live.h"

#include <tuple>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "runs/checkpoint.h"

namespace accessvdb::tools {
namespace {

using Clock = std::chrono::steady_clock;

/// With each checkpoint: whose folder it is.
constexpr const char* kNote = "live";

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

void RollingLive::begin(const RollingField& field) {
  words_.sayTiles(field.status(), field.params().tsdf.voxel_size_m);
  if (field.note().empty() && field.status().steps == 0) return;
  if (field.note() != kNote) {
    throw UnusableInput("rolling.changed", options_.map.rolling, "was made by map, and goes on with its own scans",
                        "Use map --rolling, or another folder");
  }
  saved_steps_ = field.status().steps;
  report_.scans = saved_steps_;
  report_.resumed_after_scans = saved_steps_;
  messages_.notice("going on after " + std::to_string(report_.scans) + " scans");
}

void RollingLive::afterStep(RollingField& field, bool taken) {
  const RollingStatus now = field.status();
  if (taken) words_.note(now);
  const bool due = every_s_ > 0 && std::chrono::duration<double>(Clock::now() - last_).count() >= every_s_;
  if (!due || now.steps == saved_steps_) return;
  last_ = Clock::now();
  try {
    checkpoint(field);
  } catch (const OutputError& error) {
    if (!goesOnAfter(error)) throw;
  }
}

void RollingLive::checkpoint(RollingField& field) {
  field.checkpoint(kNote);
  saved_steps_ = field.status().steps;
  last_ = Clock::now();
}

bool RollingLive::goesOnAfter(const Error& error) {
  if (error.code() != ErrorCode::Output) return false;
  if (!std::exchange(said_failed_, true)) {
    messages_.warning("rolling.disk", std::string(error.what()) +
                                          "; the flight goes on with the tiles that fit into memory, and what has no "
                                          "place there blocks");
  }
  return true;
}

void RollingLive::finish(RollingField& field) {
  checkpoint(field);
  if (field.status().points == 0) return;
  messages_.notice("scoring, and writing the tiles");
  RollingSource source;
  std::tie(source.parameters, source.flight) = plannedLive(settings_, field.params());
  source.inputs = report_.inputs;
  writeRolling(field, options_.map, writeOptions(options_.map.exported), source, report_, messages_);
  field.checkpoint(kNote);  // with the labels
  words_.sayEnd(field.status());
}

}  // namespace accessvdb::tools
