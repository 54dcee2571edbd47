// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/rolling_words.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "runs/tile_job.h"
#include "runs/tiled_map.h"

namespace accessvdb::tools {

namespace fs = std::filesystem;

namespace {

/// The same for all ways to write it, whether it is there or not.
fs::path folderAt(const std::string& given) {
  const fs::path path = fs::weakly_canonical(fs::absolute(given)).lexically_normal();
  return path.has_filename() ? path : path.parent_path();
}

bool isWithin(const fs::path& inner, const fs::path& outer) {
  const auto [at, rest] = std::mismatch(outer.begin(), outer.end(), inner.begin(), inner.end());
  return at == outer.end();
}

}  // namespace

void requireRollingFolders(const MapOptions& options) {
  const bool there = RollingField::hasCheckpoint(options.rolling), resumes = there && !options.resume.empty();
  if (there && !resumes) {
    throw OutputError("output.foreign", options.rolling, "holds the tiles of an earlier run",
                      "Add --resume " + options.rolling + " to go on with it, or choose another folder");
  }
  if (!there) RollingField::requireEmpty(options.rolling);
  if (!resumes && !options.fresh && tiles::hasPlan(options.out)) {  // said now, not after hours
    throw OutputError("output.foreign", options.out, "holds the tiles of another run",
                      "Choose another folder for --out");
  }
}

std::optional<std::string> whyNotRolling(const MapOptions& options) {
  const fs::path rolling = folderAt(options.rolling), out = folderAt(options.out);
  if (options.exported.surface) return "--surface needs all points at once";
  if (!options.checkpoint.empty()) return "its folder holds the checkpoints; leave --checkpoint out";
  if (!options.resume.empty() && folderAt(options.resume) != rolling)
    return "--resume names another folder; name the same one in both";
  if (isWithin(rolling, out) || isWithin(out, rolling))
    return "--out is the same folder, or one lies in the other; the result needs one of its own";
  return std::nullopt;
}

void RollingWords::sayTiles(const RollingStatus& now, double voxel_size_m) {
  messages_.notice("tiles of " + std::to_string(now.tile_voxels) + " voxels, " +
                   numberText(now.tile_voxels * voxel_size_m) + " m, with a margin of " +
                   numberText(now.margin_voxels * voxel_size_m) + " m for the tool; those that leave memory wait in " +
                   folder_);
}

void RollingWords::note(const RollingStatus& now) {
  if (!now.memory_short) return;
  fitting_range_m_ = std::min(fitting_range_m_, now.fitting_range_m);
  if (++short_scans_ > 1) return;
  messages_.warning(
      "rolling.short",
      "the tiles that one scan touches do not fit together: what is far is left out, and blocks; " + cure());
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
    messages_.notice(
        std::to_string(now.left_out_returns) + " returns were left out for lack of memory" +
        (short_scans_ > 0 ? ", in " + std::to_string(short_scans_) + " scans of this run" : std::string()) +
        ", and block what lies around them; " + cure());
  }
  if (!now.lost_tiles.empty()) {
    messages_.warning("rolling.lost", std::to_string(now.lost_tiles.size()) +
                                          " tiles were damaged on the disk, and what they held is missing: " +
                                          now.lost_tiles.front() + (now.lost_tiles.size() > 1 ? " and others" : ""));
  }
}

void writeRolling(RollingField& field, const MapOptions& options, const io::WriteOptions& files,
                  const RollingSource& source, RunReport& report, Messages& messages) {
  tiles::Status status;
  status.done = field.write(options.out, files, source);
  if (!options.no_clobber) removePieces(options.out);
  const tiles::Job job = {options.out, tiles::readPlan(options.out), field.tools(), field.params()};
  report.device.clear();
  writeResult({job, options, *tiles::binned(options.out, job.plan), status}, report, messages);
  messages.notice("wrote " + std::to_string(status.done.size()) + " tiles with " +
                  std::to_string(report.surface_points) + " points, field.json, preview.png and report.json into " +
                  options.out);
  messages.notice("one file of all points: accessvdb tile merge " + options.out + " --points all.ply");
}

}  // namespace accessvdb::tools
