// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/tiled_map.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/render.h"
#include "options/tools_given.h"
#include "output/progress.h"
#include "output/run_summary.h"
#include "output/stop_signal.h"
#include "runs/memory_check.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

bool goesSideBySide(const tiles::Job& job) { return job.params.change.mode == ChangeMode::Full; }

void sayDisk(const fs::path& out, std::span<io::ScanSequence* const> flights, Messages& messages) {
  double bytes = 0;
  for (const io::ScanSequence* scans : flights) bytes += static_cast<double>(scans->inputBytes());
  std::error_code error;
  const fs::space_info space = fs::space(out, error);
  messages.notice("sorting returns into tiles: about " + bytesInWords(1.2 * bytes) +
                  " on disk until all tiles are done" +
                  (error ? std::string() : ", " + bytesInWords(static_cast<double>(space.available)) + " free"));
}

/// What of it is there from before: after another flight, or with other poses.
std::string doneInWords(const tiles::Job& job, const tiles::Binned& rays) {
  try {
    const tiles::Status status = tiles::status(job.out, job.plan, rays);
    if (status.done.empty()) return {};
    return "; " + std::to_string(status.done.size()) + " are done already, " + std::to_string(status.todo.size()) +
           " are to be mapped";
  } catch (const InputError&) {  // a damaged one is named when it is needed
    return {};
  }
}

}  // namespace

tiles::Binned binWithProgress(const tiles::Job& job, std::span<io::ScanSequence* const> flights,
                              std::optional<std::uint64_t> limit_bytes, Messages& messages) {
  if (auto done = tiles::binned(job.out, job.plan)) {
    // Rays are deleted when all tiles are done, and are needed no more.
    if (tiles::status(job.out, job.plan, *done).todo.empty()) return *done;
  }
  const bool fuses = goesSideBySide(job);
  if (!fuses) sayDisk(job.out, flights, messages);
  const auto begin = Clock::now();
  Progress progress(messages, fuses ? "fusing scans, all tiles side by side" : "sorting returns into tiles",
                    job.plan.steps());
  const tiles::Watch watch = {
      [] { return stopSignal() != 0; },
      [&](std::uint64_t done, std::uint64_t, const std::string& file) { progress.show(done, file); }};
  tiles::BinLimits limits;
  limits.memory_bytes = limit_bytes.value_or(0);
  tiles::Binned rays = tiles::bin(job, flights, watch, limits);
  progress.finish();
  for (const io::ScanSequence* scans : flights) sayAboutReading(*scans, messages);
  if (rays.complete) {
    messages.notice((fuses ? "fused " : "sorted ") + std::to_string(rays.points_in) + " returns into " +
                    std::to_string(rays.returns_of.size()) + " tiles in " + secondsInWords(secondsSince(begin)) + ", " +
                    bytesInWords(static_cast<double>(rays.bytes)) + doneInWords(job, rays));
  }
  return rays;
}

std::vector<tiles::Tile> runWithProgress(const TileWork& work, const std::vector<tiles::TileId>& todo,
                                         Messages& messages) {
  std::vector<tiles::Tile> done;
  const tiles::Watch watch = {[] { return stopSignal() != 0; }, [](auto...) {}};
  for (std::size_t n = 0; n < todo.size() && stopSignal() == 0; ++n) {
    for (tiles::Tile& tile : tiles::run(work.job, work.rays, todo[n], work.limits, watch)) {
      messages.notice("tile " + tile.id.name() + " (" + std::to_string(n + 1) + " of " + std::to_string(todo.size()) +
                      "): " + std::to_string(tile.points) + " points from " + std::to_string(tile.returns) +
                      " returns in " + secondsInWords(tile.seconds));
      done.push_back(std::move(tile));
    }
  }
  return done;
}

void writeResult(const TiledResult& result, RunReport& report, Messages& messages) {
  const fs::path& out = result.job.out;
  const tiles::Plan& plan = result.job.plan;
  report.replaces_files = true;
  tiles::writeIndex(out, plan, result.status);
  addOutputs(report.outputs, out, {"field.json"});
  const io::FieldParts picture = tiles::partsOf(tiles::readIndex(out), kPicturePoints);
  if (std::ranges::any_of(picture.labels, [](std::uint64_t count) { return count > 0; })) {
    io::renderField(out / "preview.png", picture, renderOptions(result.options.picture));
    addOutputs(report.outputs, out, {"preview.png"});
  }
  report.inputs = result.rays.inputs;
  report.scans = result.rays.steps;
  report.points_in = result.rays.points_in;
  report.points_used = result.rays.points_used;
  report.dropped = result.rays.dropped;
  TilesReport tiles;
  tiles.tile_voxels = plan.tile_voxels;
  tiles.margin_voxels = plan.margin_voxels;
  tiles.done = result.status.done.size();
  tiles.todo = result.status.todo.size();
  tiles.split = result.status.split;
  tiles.poison = result.status.poison;
  tiles.ray_bytes = result.rays.bytes;
  for (const tiles::Tile& tile : result.status.done) {
    report.surface_points += tile.points;
    for (std::size_t n = 0; n < tile.labels.size(); ++n) report.labels[n] += tile.labels[n];
    for (std::size_t n = 0; n < tile.reasons.size(); ++n) report.reasons[n] += tile.reasons[n];
    report.device = report.device.empty() || report.device == tile.device ? tile.device : "mixed";
    tiles.seconds += tile.seconds;
    tiles.peak_bytes = std::max(tiles.peak_bytes, tile.peak_bytes);
  }
  report.tiles = tiles;
  if (result.rays.truncated_points > 0) {
    messages.warning("input.truncated",
                     std::to_string(result.rays.truncated_points) + " points announced by the files are missing");
  }
}

void requireRoomForGrids(const tiles::Status& status, std::optional<std::uint64_t> limit_bytes) {
  // The points as a list and as voxels; one grid of the map at a time, which is written from a copy.
  constexpr double kBytesPerPoint = sizeof(SurfacePoint) + 64, kBytesPerLeaf = 2 * 2200, kProcessBytes = 200e6;
  double leaves = 0, points = 0;
  for (const tiles::Tile& tile : status.done) {
    leaves += static_cast<double>(tile.leaves);
    points += static_cast<double>(tile.points);
  }
  const double bytes = kProcessBytes + kBytesPerPoint * points + kBytesPerLeaf * leaves;
  if (!limit_bytes || bytes <= static_cast<double>(*limit_bytes)) return;
  throw ResourceLimit("limit.memory", "--vdb",
                      "one file of all grids needs about " + bytesInWords(bytes) + ", more than " +
                          bytesInWords(static_cast<double>(*limit_bytes)),
                      "Load the field.vdb of each tile instead: they share one index space");
}

void requireTilesPossible(const MapOptions& options, const FieldParams& params) {
  if (const auto reason = whyNotInTiles(options, params)) {
    throw InvalidArgument("usage.tiles", "--tiles " + options.tiles, *reason,
                          "Leave that option out, or use --tiles off");
  }
}

int mapInTiles(const PlanSources& sources, std::int32_t chosen_voxels, RunReport& report, Messages& messages) {
  const auto begin = Clock::now();
  const MapOptions& options = sources.options;
  requireTilesPossible(options, sources.params);
  if (options.update_every > 0) messages.notice("tiles are scored once at the end; --update-every changes nothing");
  tiles::Job job = {options.out, {}, sources.tools, sources.params};
  job.params.mirror_distance = false;  // only for kernels of this process
  job.plan = planOf(sources, chosen_voxels, messages);
  report.device.clear();

  io::ScanSequence* const flights[] = {&sources.scans};
  const tiles::Binned rays = binWithProgress(job, flights, memoryLimit(options), messages);
  tiles::Status status;
  if (rays.complete) {
    if (rays.points_used == 0) {
      report.points_in = rays.points_in;
      report.dropped = rays.dropped;
      throw UnusableInput("scans.no_returns", options.scans,
                          "none of the " + std::to_string(rays.points_in) + " returns in " +
                              std::to_string(rays.steps) + " scans can be used (" + droppedInWords(report) + ")",
                          "Check the scans, --min-range and --max-range");
    }
    const tiles::RunLimits limits = {memoryLimit(options).value_or(0), writeOptions(options.exported)};
    runWithProgress({job, rays, limits}, tiles::status(job.out, job.plan, rays).todo, messages);
    status = tiles::status(job.out, job.plan, rays);
    writeResult({job, options, rays, status}, report, messages);
  }
  const int signal = stopSignal();
  if (signal != 0) {
    messages.notice("stopped after " + std::to_string(status.done.size()) + " of " +
                    std::to_string(rays.returns_of.size()) + " tiles; the same command goes on from here");
  } else {
    tiles::removeLeftovers(job.out);
    tiles::removeOutdated(job.out, status);
    if (!options.keep_rays) tiles::removeRays(job.out);
    messages.notice("done in " + secondsInWords(secondsSince(begin)) + "; wrote " + std::to_string(status.done.size()) +
                    " tiles with " + std::to_string(report.surface_points) +
                    " points, field.json, preview.png and report.json into " + job.out.string());
    messages.notice("one file of all points: accessvdb tile merge " + job.out.string() + " --points all.ply");
  }
  report.exit_code = signal == 0 ? 0 : 128 + signal;
  return report.exit_code;
}

}  // namespace accessvdb::tools
