// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/rolling_words.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "accessvdb/tiles.h"
#include "runs/tiled_map.h"

namespace accessvdb::tools {

namespace fs = std::filesystem;

std::optional<std::string> whyNotRolling(const MapOptions& options) {
  const auto isSameFolder = [](const fs::path& a, const fs::path& b) {
    return fs::weakly_canonical(a) == fs::weakly_canonical(b);
  };
  if (options.exported.surface) return "--surface needs all points at once";
  if (!options.checkpoint.empty()) return "its folder holds the checkpoints; leave --checkpoint out";
  if (!options.resume.empty() && !isSameFolder(options.resume, options.rolling)) {
    return "--resume names another folder; name the same one in both";
  }
  if (isSameFolder(options.out, options.rolling)) return "--out is the same folder; the result needs one of its own";
  return std::nullopt;
}

void RollingWords::sayTiles(const RollingStatus& now, double voxel_size_m) {
  messages_.notice("tiles of " + std::to_string(now.tile_voxels) + " voxels, " +
                   numberText(now.tile_voxels * voxel_size_m) + " m, with a margin of " +
                   numberText(now.margin_voxels * voxel_size_m) + " m for the tool; those that leave memory wait in " +
                   folder_);
}

bool RollingWords::note(const RollingStatus& now) {
  if (!now.memory_short) return false;
  fitting_range_m_ = std::min(fitting_range_m_, now.fitting_range_m);
  return ++short_scans_ == 1;
}

std::string RollingWords::cure() const {
  const bool by_range = std::isfinite(fitting_range_m_) && fitting_range_m_ > 0;
  return "more --max-memory" +
         (by_range ? ", or --max-range " + numberText(std::floor(10 * fitting_range_m_) / 10) + ", would take all"
                   : std::string(" would take them"));
}

void RollingWords::sayEnd(const RollingStatus& now) {
  messages_.notice(std::to_string(now.tiles) + " tiles, " + std::to_string(now.tiles_in_memory) +
                   " of them in memory; " + std::to_string(now.saved) + " left it, " + std::to_string(now.loaded) +
                   " came back");
  if (now.left_out_returns > 0) {
    messages_.warning("rolling.short", std::to_string(now.left_out_returns) +
                                           " returns were left out for lack of memory, in " +
                                           std::to_string(short_scans_) +
                                           " scans of this run, and block what lies around them; " + cure());
  }
  if (!now.lost_tiles.empty()) {
    messages_.warning("rolling.lost", std::to_string(now.lost_tiles.size()) +
                                          " tiles were damaged on the disk, and all their points are unscored: " +
                                          now.lost_tiles.front() + (now.lost_tiles.size() > 1 ? " and others" : ""));
  }
}

void writeRolling(RollingField& field, const MapOptions& options, const io::WriteOptions& files,
                  const RollingSource& source, RunReport& report, Messages& messages) {
  tiles::Status status;
  status.done = field.write(options.out, files, source);
  const tiles::Job job = {options.out, tiles::readPlan(options.out), field.tools(), field.params()};
  report.device.clear();
  writeResult({job, options, *tiles::binned(options.out, job.plan), status}, report, messages);
  messages.notice("wrote " + std::to_string(status.done.size()) + " tiles with " +
                  std::to_string(report.surface_points) + " points, field.json, preview.png and report.json into " +
                  options.out);
  messages.notice("one file of all points: accessvdb tile merge " + options.out + " --points all.ply");
}

}  // namespace accessvdb::tools
