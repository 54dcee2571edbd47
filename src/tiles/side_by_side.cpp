// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/side_by_side.h"

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/rolling_field.h"
#include "field/field_access.h"
#include "field/state/state_reader.h"
#include "io/streams/input_file.h"
#include "points/point_store.h"
#include "tiles/json_file.h"
#include "tiles/own_files.h"
#include "tiles/planned_inputs.h"
#include "tiles/ray_files.h"
#include "tiles/rolling_files.h"
#include "tiles/rolling_manifest.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr const char* kAgain = "Delete it and run accessvdb tile bin again";

FieldParams paramsOf(const Job& job) {
  FieldParams params = job.params;
  params.origin_W = job.plan.origin_W;
  return params;
}

/// What rolling.json keeps for the next call.
struct Note {
  std::string plan;  ///< its id after the flight of the last step
  std::uint64_t truncated_points = 0;
  std::map<std::string, std::string> sha256;  ///< of files that were read
};

std::string textOf(const Note& note) {
  return Json({{"plan", note.plan}, {"truncated_points", note.truncated_points}, {"sha256", note.sha256}}).dump();
}

using Inputs = std::vector<io::InputFile>;

/// @param before  as for PlannedInputs::all()  @return nothing if the steps are not those of the plan
std::optional<Note> noteFrom(const std::string& text, std::uint64_t steps, const Plan& plan, const Inputs& before) {
  if (steps == 0) return Note();
  if (steps > plan.steps()) return std::nullopt;
  try {
    const Json json = Json::parse(text);
    Note note;
    json.at("plan").get_to(note.plan);
    json.at("truncated_points").get_to(note.truncated_points);
    json.at("sha256").get_to(note.sha256);
    const bool same = std::ranges::all_of(before, [&note](const io::InputFile& input) {
      const auto read = note.sha256.find(input.path);
      return read == note.sha256.end() || read->second == input.sha256;
    });
    if (same && note.plan == shardPlanId(plan, steps - 1)) return note;
  } catch (const Json::exception&) {  // of somebody else
  }
  return std::nullopt;
}

RollingManifest manifestOf(const Job& job) {
  const fs::path folder = raysFolder(job.out);
  if (!hasManifest(folder)) {
    throw InputError("rays.missing", job.out.string(), "holds no rays of this plan", "Run accessvdb tile bin first");
  }
  std::optional<RollingManifest> manifest;
  try {
    readManifest(folder, [&](const Json& json) {
      const FieldParams params = toolParams(job.tools.front(), paramsOf(job)).resolved();
      manifest = manifestFrom(json, folder, {job.tools, params, job.plan.tile_voxels});
    });
  } catch (const Error& error) {
    if (!error.id().starts_with("rolling.")) throw;
    throw InputError("rays.damaged", (folder / kRollingManifest).string(), error.problem(), kAgain);
  }
  return *std::move(manifest);
}

RollingFiles filesOf(const Job& job, const Json& tile) {
  const TileId id = TileId::parse(tile.at("tile"));
  return {raysFolder(job.out), {id.x, id.y}, tile.at("serial").get<std::uint64_t>()};
}

/// Whether all scans were taken, and none that has changed. @param before  of a finished bin()
bool hasTakenAll(const RollingManifest& manifest, const Plan& plan, const Inputs& before) {
  const std::uint64_t steps = manifest.stamps_s.size();
  return steps == plan.steps() && noteFrom(manifest.note, steps, plan, before);
}

/// One pass over all scans.
class SideBySide {
 public:
  /// @param before  as for PlannedInputs::all()
  SideBySide(const Job& job, std::span<io::ScanSequence* const> flights, const Watch& watch, const BinLimits& limits,
             Inputs before)
      : job_(job),
        flights_(flights),
        watch_(watch),
        limits_(limits),
        before_(std::move(before)),
        inputs_(job.plan),
        field_(open()) {
    inputs_.restore(std::move(note_.sha256));
  }

  /// @return false if stopped
  bool run() {
    std::uint64_t flight_begin = 0;
    for (std::size_t n = 0; n < flights_.size(); ++n) {
      const std::uint64_t flight_end = flight_begin + job_.plan.flights[n].stamps_s.size();
      for (std::uint64_t step = std::max(field_.status().steps, flight_begin); step < flight_end; ++step) {
        if (watch_.stop()) {
          save();
          return false;
        }
        take(*flights_[n], step - flight_begin);
        if (std::chrono::duration<double>(Clock::now() - saved_at_).count() >= limits_.checkpoint_every_s) save();
      }
      flight_begin = flight_end;
    }
    save();
    return true;
  }

  [[nodiscard]] Binned binned() const {
    const RollingManifest manifest = manifestOf(job_);
    Binned result;
    result.complete = true;
    result.steps = job_.plan.steps();
    result.points_in = manifest.taken.points_in;
    result.points_used = manifest.taken.points_used;
    result.dropped = manifest.taken.dropped;
    result.truncated_points = note_.truncated_points;
    result.inputs = inputs_.all(job_.out, before_);
    // Rays of any flight may have opened something anywhere.
    const auto flights = static_cast<std::uint32_t>(job_.plan.flights.size());
    for (const Json& tile : manifest.tiles) {
      const RollingFiles files = filesOf(job_, tile);
      result.bytes += io::inputFileSize(files.state) + io::inputFileSize(files.ids);
      result.returns_of.push_back({TileId::parse(tile.at("tile")), tile.at("returns"), flights});
      result.returns_stored += result.returns_of.back().returns;
    }
    std::ranges::stable_sort(result.returns_of, std::ranges::greater(), &TileReturns::returns);
    return result;
  }

 private:
  /// What an earlier call has come to, or a new one.
  RollingField open() {
    const fs::path folder = raysFolder(job_.out);
    FieldParams params = paramsOf(job_);
    params.backend = BackendKind::Cpu;  // nothing is scored
    RollingOptions options;
    options.folder = folder;
    options.process_limit_bytes = limits_.memory_bytes;
    options.tile_voxels = job_.plan.tile_voxels;
    if (RollingField::hasCheckpoint(folder)) {
      try {
        RollingField field = RollingField::resume(job_.tools, params, options);
        if (auto note = noteFrom(field.note(), field.status().steps, job_.plan, before_)) {
          note_ = *std::move(note);
          return field;
        }
      } catch (const Error& error) {  // damaged, or of another plan: as shards are, it is made again
        if (!error.id().starts_with("rolling.")) throw;
      }
    }
    removeRays(job_.out);
    return {job_.tools, params, options};
  }

  void take(io::ScanSequence& scans, std::uint64_t step) {
    const io::ScanRecord record = scans.read(step);
    inputs_.note(record.path);
    const std::vector<std::int32_t> attributes = io::attributesFor(record, job_.params.carry.size());
    const std::optional<double> stamp_s = scans.stamp_s(step);
    if (record.points_W.empty()) {
      field_.integrateScan(record.points_S, record.T_W_S, stamp_s, attributes);
    } else {
      field_.integrateRays(record.points_W, record.origins_W, stamp_s, attributes);
    }
    note_.truncated_points += record.truncated_points;
    const RollingStatus now = field_.status();
    if (now.memory_short) refuseShort(now);
    if (!now.lost_tiles.empty()) {
      throw InputError("rays.damaged", raysFolder(job_.out).string(),
                       "holds a damaged state of tile " + now.lost_tiles[0], kAgain);
    }
    watch_.progress(now.steps, job_.plan.steps(), fs::path(record.path).filename().string());
  }
  /// Nothing may be left out: the result would not be that of one piece.
  [[noreturn]] static void refuseShort(const RollingStatus& now) {
    std::string advice = "Allow more memory, or use smaller tiles";
    if (const double range_m = std::floor(10 * now.fitting_range_m) / 10; range_m > 0 && std::isfinite(range_m)) {
      const std::string text = std::to_string(range_m);
      advice += ", or max_range_m " + text.substr(0, text.find('.') + 2);
    }
    throw ResourceLimit("limit.memory", "scan " + std::to_string(now.steps),
                        "comes near more tiles than fit into memory together", advice);
  }

  void save() {
    if (const std::uint64_t steps = field_.status().steps; steps > 0) note_.plan = shardPlanId(job_.plan, steps - 1);
    note_.sha256 = inputs_.hashes();
    field_.checkpoint(textOf(note_));
    saved_at_ = Clock::now();
  }

  const Job& job_;
  std::span<io::ScanSequence* const> flights_;
  const Watch& watch_;
  BinLimits limits_;
  Inputs before_;
  PlannedInputs inputs_;
  Note note_;
  RollingField field_;
  Clock::time_point saved_at_ = Clock::now();
};

}  // namespace

bool goesSideBySide(const FieldParams& params) { return params.change.mode == ChangeMode::Full; }

bool hasFused(const Job& job, const std::vector<io::InputFile>& inputs) {
  try {
    const RollingManifest manifest = manifestOf(job);
    if (!hasTakenAll(manifest, job.plan, inputs)) return false;
    return std::ranges::all_of(manifest.tiles, [&](const Json& tile) {
      const RollingFiles files = filesOf(job, tile);
      return io::isFile(files.state) && io::isFile(files.ids);
    });
  } catch (const InputError&) {
    return false;
  }
}

Binned passSideBySide(const Job& job, std::span<io::ScanSequence* const> flights, const Watch& watch,
                      const BinLimits& limits) {
  const auto done = binned(job.out, job.plan);
  const Inputs before = done ? done->inputs : Inputs();
  if (done && hasFused(job, before)) return *done;
  Binned result;
  {
    SideBySide pass(job, flights, watch, limits, before);
    if (!pass.run()) return result;
    result = pass.binned();
  }
  malloc_trim(0);  // what comes next starts with the memory that this has given back
  writeBinned(job.out, job.plan, result);
  return result;
}

FusedTile loadFused(const Job& job, const Inputs& inputs, const TileId& id) {
  const RollingManifest manifest = manifestOf(job);
  // A later call of bin() may have begun again, and have been stopped, or refused a scan that has changed.
  if (!hasTakenAll(manifest, job.plan, inputs)) {
    throw InputError("rays.missing", job.out.string(), "holds tiles that have not taken the scans of this plan",
                     "Run accessvdb tile bin first");
  }
  const auto entry =
      std::ranges::find_if(manifest.tiles, [&](const Json& tile) { return tile.at("tile") == id.name(); });
  if (entry == manifest.tiles.end()) {
    throw InputError("rays.damaged", (raysFolder(job.out) / kRollingManifest).string(), "has no tile " + id.name(),
                     kAgain);
  }
  const RollingFiles files = filesOf(job, *entry);
  try {
    const auto sha256 = entry->at("files_sha256").get<std::string>();
    internal::StateReader state(files.state);
    files.requireWritten(state, sha256);
    auto tables = std::make_unique<internal::SharedTables>();
    AccessibilityField field = internal::FieldAccess::load(state, job.tools, job.params, {}, tables.get());
    const std::vector<std::uint32_t> ids = files.readIds(internal::FieldAccess::points(field).size(), sha256);
    internal::FieldAccess::advanceTime(field, manifest.latest_s, manifest.age_s);
    const auto step_of = [ids, first_ids = manifest.first_ids](std::uint32_t point) {
      const auto after = std::upper_bound(first_ids.begin(), first_ids.end(), ids[point]);
      return static_cast<std::uint32_t>(after - first_ids.begin()) - 1;
    };
    return {std::move(tables), std::move(field), entry->at("returns"), step_of};
  } catch (const InputError& error) {
    if (!error.id().starts_with("state.") && !error.id().starts_with("input.")) throw;
    throw InputError("rays.damaged", error.subject(), error.problem(), kAgain);
  }
}

}  // namespace accessvdb::tiles
