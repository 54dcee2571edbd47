// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/rolling_result.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <system_error>
#include <utility>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/memory_prediction.h"
#include "launch/stopwatch.h"
#include "tiles/point_file.h"
#include "tiles/ray_files.h"
#include "tiles/tile_files.h"
#include "tiles/tile_writer.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

/// Of the field's own folder: what an earlier call has left in these two is deleted.
void requireApart(const fs::path& own, const fs::path& out) {
  for (const char* const name : {"rays", "tiles"}) {
    std::error_code error;
    const fs::path within =
        fs::weakly_canonical(own, error).lexically_relative(fs::weakly_canonical(out / name, error));
    if (within.empty() || *within.begin() == "..") continue;
    throw OutputError("output.foreign", out.string(), "holds the folder of this very field", "Choose another folder");
  }
}

/// Whether a folder holds the result of the same steps.
bool isOf(const Plan& plan, const fs::path& out) {
  const Plan there = readPlan(out);
  return there.id() == plan.id() && there.flights.size() == 1 &&
         there.flights.front().stamps_s == plan.flights.front().stamps_s;
}

/// A tile with all its files as they were written.
std::optional<Tile> wholeAt(const fs::path& out, const Plan& plan, const Tile& like) {
  try {
    auto tile = readTile(out, plan, like.id, {like.id, like.returns, 1});
    return tile && isAsWritten(out, *tile) ? std::move(tile) : std::nullopt;
  } catch (const InputError&) {
    return std::nullopt;
  }
}

}  // namespace

RollingResult::RollingResult(const Of& of, const RollingSource& source, fs::path out, const fs::path& own)
    : of_(of), source_(source), out_(std::move(out)) {
  requireOwnFolders(out_);
  requireApart(own, out_);
  plan_ = planOf();
  // One that was killed just before its end may be repeated.
  if (hasPlan(out_) && !isOf(plan_, out_)) {
    throw OutputError("output.foreign", out_.string(), "holds the tiles of another run", "Choose another folder");
  }
}

Plan RollingResult::planOf() const {
  const std::vector<ToolSpec>& tools = of_.made_with.tools;
  Plan plan;
  plan.program = ACCESSVDB_VERSION;
  plan.parameters = describeTools(tools, of_.made_with.params) + source_.parameters;
  plan.frame = source_.frame;
  for (const ToolSpec& tool : tools) plan.tool_name += (plan.tool_name.empty() ? "" : ", ") + tool.name;
  if (tools.size() == 1) plan.tool_name = tools.front().tool.name();
  plan.tool_sha256 = toolListSha256(tools);
  plan.origin_W = of_.origin_W;
  plan.voxel_size_m = of_.made_with.params.tsdf.voxel_size_m;
  plan.tile_voxels = of_.made_with.tile_voxels;
  plan.margin_voxels = of_.margin_voxels;
  Flight flight = source_.flight;
  flight.stamps_s.clear();
  for (const double stamp_s : of_.stamps_s) flight.stamps_s.push_back(std::isfinite(stamp_s) ? stamp_s : 0);
  plan.flights.push_back(std::move(flight));
  return identified(std::move(plan));
}

bool RollingResult::isRepeat() const {
  if (!hasPlan(out_)) return false;
  try {
    const auto before = binned(out_, plan_);
    return before && std::ranges::all_of(source_.inputs, [&](const io::InputFile& input) {
             const auto same = std::ranges::find(before->inputs, input.path, &io::InputFile::path);
             return same == before->inputs.end() || same->sha256 == input.sha256;
           });
  } catch (const InputError&) {
    return false;
  }
}

void RollingResult::refuseLost(const TileId& id) const {
  throw InputError("rolling.damaged", "tile " + id.name(),
                   "was damaged in the folder of the field, and is whole in " + out_.string(),
                   "Keep that result, or choose another folder for this one");
}

std::vector<Tile> RollingResult::write(RollingTiles& tiles, const io::WriteOptions& files) const {
  io::prepareOutputFolder(out_);
  const auto isLost = [&](const TileIndex& index) {
    return std::ranges::count(tiles.lost(), TileId{index.first, index.second, {}}.name()) > 0;
  };
  if (isRepeat()) {
    removeAttempts(out_);
  } else {
    // What a result that was cut off has of them may be all that there is.
    for (const TileIndex& index : hasPlan(out_) ? tiles.all() : std::vector<TileIndex>()) {
      tiles.visit(index, [&](const RollingTile& tile) {
        Tile like;
        like.id = {index.first, index.second, {}};
        like.returns = tile.returns;
        if (isLost(index) && wholeAt(out_, plan_, like)) refuseLost(like.id);
      });
    }
    removePlan(out_);
  }
  std::vector<TileIndex> order = tiles.all();
  // Those that were lost first: one of them that may not replace a whole tile is refused before any other is replaced.
  std::ranges::stable_partition(order, isLost);
  Status status;
  for (const TileIndex& index : order) {
    tiles.visit(index, [&](const RollingTile& tile) {
      status.done.push_back(writeOne(index, tile, contentOf(tiles, tile), isLost(index), files));
    });
  }
  std::ranges::sort(status.done, {}, [](const Tile& tile) { return TileIndex{tile.id.x, tile.id.y}; });
  removeOutdated(out_, status);
  removeRays(out_);
  writeBinned(out_, plan_, raysOf(status.done));
  writeIndex(out_, plan_, status);
  writePlan(out_, plan_);  // last: until then nobody takes it for whole
  return std::move(status.done);
}

/// Of a tile that is what tile run makes of the same returns; else nothing, and a correction makes it again.
std::string RollingResult::contentOf(const RollingTiles& tiles, const RollingTile& tile) const {
  const bool alone = of_.made_with.params.change.mode != ChangeMode::Full;  // what opens depends on other tiles
  return alone && tile.rays && tiles.closed().empty() ? tiles::contentOf(plan_, *tile.rays) : std::string();
}

Tile RollingResult::writeOne(const TileIndex& index, const RollingTile& tile, const std::string& content, bool lost,
                             const io::WriteOptions& files) const {
  const kernels::Stopwatch watch;
  Tile written;
  written.id = {index.first, index.second, {}};
  written.returns = tile.returns;
  written.content = content;
  AttemptFolder folder(out_, written.id, AttemptFolder::Leftovers::AreGone);
  const auto step_of = [&](std::uint32_t id) {
    const auto after = std::upper_bound(of_.first_ids.begin(), of_.first_ids.end(), tile.ids[id]);
    return static_cast<std::uint32_t>(after - of_.first_ids.begin()) - 1;
  };
  writeTileFiles(tile.field, folder.path(), files, step_of, written);
  written.seconds = watch.milliseconds() / 1000;
  written.peak_bytes = peakMemoryBytes();
  writeTile(folder.path(), plan_, written);
  if (const auto before = wholeAt(out_, plan_, written)) {
    if (before->sha256 == written.sha256) return *before;
    if (lost) refuseLost(written.id);
  }
  removeBinned(out_);  // until the end nobody takes old and new tiles together for a whole result
  folder.replace();
  return written;
}

Binned RollingResult::raysOf(const std::vector<Tile>& done) const {
  Binned rays;
  rays.complete = true;
  rays.steps = of_.first_ids.size();
  rays.points_in = of_.taken.points_in;
  rays.points_used = of_.taken.points_used;
  rays.dropped = of_.taken.dropped;
  rays.inputs = source_.inputs;
  rays.truncated_points = source_.truncated_points;
  rays.farthest_m = of_.farthest_m;
  for (const Tile& tile : done) {
    rays.returns_of.push_back({tile.id, tile.returns, 1, tile.content});
    rays.returns_stored += tile.returns;
  }
  return rays;
}

}  // namespace accessvdb::tiles
