// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// From the returns of a tile to its files.
#include <malloc.h>
#include <algorithm>
#include <chrono>
#include <limits>
#include <new>
#include <optional>
#include <ostream>

#include "accessvdb/error.h"
#include "accessvdb/program/memory_prediction.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tiles.h"
#include "accessvdb/tool_tables.h"
#include "field/field_access.h"
#include "field/field_files.h"
#include "points/point_store.h"
#include "tiles/plan_lock.h"
#include "tiles/point_file.h"
#include "tiles/ray_files.h"
#include "tiles/ray_shard.h"
#include "tiles/side_by_side.h"
#include "tiles/tile_files.h"
#include "tiles/tile_writer.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

struct DoesNotFit {};
struct Stopped {};

struct FusedReturns {
  std::uint64_t all = 0, largest_step = 0;
};

/// The peak that a run of the tile comes to, if no more returns come.
double peakBytesOf(const internal::FieldCounts& counts, const FusedReturns& fused, const Job& job,
                   const ToolTableBytes& tables) {
  MemoryPrediction prediction;
  prediction.remembered_directions = rememberedDirections(job.tools, job.params);
  prediction.returns = fused.all;
  prediction.largest_step = fused.largest_step;
  prediction.cone_leaves = static_cast<double>(counts.distance_leaves);
  prediction.band_leaves = static_cast<double>(counts.cleared_leaves);
  prediction.nodes = static_cast<double>(counts.nodes);
  prediction.surface_points = static_cast<double>(counts.points);
  prediction.surface_leaves = static_cast<double>(counts.point_leaves);
  return peakBytes(prediction.bytes(RunOutput::Tile), tables);
}

/// What stays the same for all parts of a tile.
struct Run {
  const Job& job;
  const RunLimits& limits;
  const Watch& watch;
  const TileReturns& whole;
  const std::vector<io::InputFile>& inputs;
};

/// Whether a newer plan still has the tile, made from the same returns in the same way.
bool isInPlan(const Run& run) {
  if (!hasPlan(run.job.out)) return false;
  const Plan now = readPlan(run.job.out);
  if (now.id() == run.job.plan.id()) return true;
  const auto rays = run.whole.content.empty() ? std::nullopt : binned(run.job.out, now);
  return rays && std::ranges::any_of(rays->returns_of, [&](const TileReturns& tile) {
           return tile.id == run.whole.id && tile.content == run.whole.content;
         });
}

/// A run takes its time: by now what a newer plan has made may be there, and must stay.
template <typename Change>
void whilePlanned(const Run& run, const TileId& id, const Change& change) {
  const PlanLock lock(run.job.out, PlanLock::Kind::ToRead);
  if (!isInPlan(run)) {
    throw UnusableInput("plan.changed", run.job.out.string(),
                        "has another plan than when tile " + id.name() + " was begun, so that tile is not kept",
                        "Run accessvdb tile bin and tile run again");
  }
  change();
}

/// One attempt at one tile.
class TileRun {
 public:
  TileRun(const Run& run, const TileId& id)
      : run_(run), job_(run.job), tables_(toolTableBytes(job_.tools, job_.params)) {
    tile_.id = id;
    tile_.content = run.whole.content;
  }

  /// @throws DoesNotFit, Stopped
  Tile run() {
    const auto begin = Clock::now();
    FieldParams params = job_.params;
    params.origin_W = job_.plan.origin_W;
    params.window = tile_.id.window(job_.plan.tile_voxels);
    AttemptFolder folder(job_.out, tile_.id);
    if (goesSideBySide(params)) {
      FusedTile fused = loadFused(job_, run_.inputs, tile_.id);
      tile_.returns = fused.returns;
      requireFit(peakBytesOf(internal::FieldAccess::counts(fused.field), {fused.returns, 0}, job_, tables_));
      score(fused.field, folder, fused.stepOf);
    } else {
      AccessibilityField field(job_.tools, params);
      integrateAll(field);
      score(field, folder, [this](std::uint32_t id) { return stepOf(id); });
    }
    tile_.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    tile_.peak_bytes = peakMemoryBytes();
    writeTile(folder.path(), job_.plan, tile_);
    whilePlanned(run_, tile_.id, [&] { folder.putInPlace(job_.plan, run_.whole); });
    return tile_;
  }

 private:
  void requireFit(double bytes) const {
    if (run_.limits.memory_bytes > 0 && bytes > static_cast<double>(run_.limits.memory_bytes)) throw DoesNotFit{};
  }

  void score(AccessibilityField& field, const AttemptFolder& folder, const StepOfPoint& step_of) {
    field.update();
    io::WriteOptions files = run_.limits.files;
    files.frame = job_.plan.frame;
    writeTileFiles(field, folder.path(), files, step_of, tile_);
  }

  void integrateAll(AccessibilityField& field) {
    const std::vector<TileRays> rays = raysOf(job_.out, job_.plan, {tile_.id.x, tile_.id.y});
    RayBlock block;
    FusedReturns fused;
    for (const TileRays& part : rays) {
      SegmentReader reader(part.shard, part.segment);
      while (reader.next(block)) {
        if (run_.watch.stop()) throw Stopped{};
        if (!steps_.empty() && block.step <= steps_.back()) reader.fail();
        // The first point that the step adds has this id.
        first_ids_.push_back(static_cast<std::uint32_t>(internal::FieldAccess::points(field).size()));
        steps_.push_back(block.step);
        fused.largest_step = std::max<std::uint64_t>(fused.largest_step, block.p_L.size());
        requireFit(peakBytesOf(internal::FieldAccess::counts(field), fused, job_, tables_));
        constexpr double kNoStamp = std::numeric_limits<double>::quiet_NaN();
        fused.all +=
            internal::FieldAccess::integrateLocal(field, block.p_L, block.q_L, kNoStamp, block.attributes).points_used;
        requireFit(peakBytesOf(internal::FieldAccess::counts(field), fused, job_, tables_));
      }
    }
    tile_.returns = fused.all;
  }

  /// The last step that began at or before this id; steps without new points share their first id with the next.
  [[nodiscard]] std::uint32_t stepOf(std::uint32_t id) const {
    const auto after = std::upper_bound(first_ids_.begin(), first_ids_.end(), id);
    return steps_[static_cast<std::size_t>(after - first_ids_.begin()) - 1];
  }

  const Run& run_;
  const Job& job_;
  ToolTableBytes tables_;
  Tile tile_;
  std::vector<std::uint32_t> first_ids_, steps_;  ///< of each step that the tile has returns of
};

/// Whether an error means that a smaller tile may succeed.
bool isShortOfMemory(const Error& error) {
  const bool of_the_tool = error.id().starts_with("tool.");  // as large for every tile
  return (error.code() == ErrorCode::Resource && !of_the_tool) || error.id() == "device.memory";
}

/// @return why it did not fit, if it did not
std::optional<std::string> attempt(const Run& run, const TileId& id, std::vector<Tile>& done) {
  std::optional<std::string> reason;
  try {
    done.push_back(TileRun(run, id).run());
  } catch (const DoesNotFit&) {
    reason = "needs more than " + std::to_string(run.limits.memory_bytes >> 20) + " MiB";
  } catch (const std::bad_alloc&) {
    reason = "needs more memory than there is";
  } catch (const Error& error) {
    if (!isShortOfMemory(error)) throw;
    reason = error.problem();
  }
  malloc_trim(0);  // the next tile starts with the memory that this one has given back
  return reason;
}

/// Whether a tile with this edge may be run: smaller ones would mostly repeat what their neighbours do.
bool isLargeEnough(const Plan& plan, std::int32_t edge_voxels) {
  return edge_voxels >= FieldWindow::kEdge && edge_voxels >= 2 * plan.margin_voxels;
}

std::int32_t edgeOf(const Plan& plan, const TileId& id) {
  const std::size_t levels = id.quarters.size();
  return levels < 31 ? plan.tile_voxels >> levels : 0;
}

/// What every tile needs, however small: splitting would not help.
void requireRoomForTool(const Job& job, const RunLimits& limits) {
  const double bytes = peakBytesOf({}, {}, job, toolTableBytes(job.tools, job.params));
  if (limits.memory_bytes == 0 || bytes <= static_cast<double>(limits.memory_bytes)) return;
  const auto megabytes = [](double count) { return std::to_string(static_cast<std::uint64_t>(count) >> 20) + " MiB"; };
  throw ResourceLimit("limit.memory", "tool " + job.plan.tool_name,
                      "the program and the tool's tables need about " + megabytes(bytes) + ", more than " +
                          megabytes(static_cast<double>(limits.memory_bytes)),
                      "Allow more memory, or use a larger voxel");
}

void runInto(const Run& run, const TileId& id, std::vector<Tile>& done) {
  const Job& job = run.job;
  if (const auto tile = readTile(job.out, job.plan, id, run.whole)) {
    if (isAsWritten(job.out, *tile)) {  // else it is made again, which is what errors about it advise
      done.push_back(*tile);
      return;
    }
    whilePlanned(run, id, [&] { removeTile(job.out, id); });
  }
  if (!isSplit(job.out, job.plan, id, run.whole)) {
    requireRoomForTool(job, run.limits);
    const auto reason = attempt(run, id, done);
    if (!reason) return;
    if (goesSideBySide(job.params)) {
      throw ResourceLimit("limit.memory", "tile " + id.name(), *reason + ", and what has gone takes whole tiles",
                          "Allow more memory, or plan smaller tiles");
    }
    if (!isLargeEnough(job.plan, edgeOf(job.plan, id) / 2)) {
      throw ResourceLimit("limit.memory", "tile " + id.name(),
                          *reason + ", and is already the smallest that the tool allows",
                          "Allow more memory, or use a larger voxel");
    }
    whilePlanned(run, id, [&] { markSplit(job.out, job.plan, id, run.whole); });
  }
  for (const TileId& quarter : id.split()) runInto(run, quarter, done);
}

void statusOf(const fs::path& out, const Plan& plan, const TileReturns& whole, const TileId& id, Status& status) {
  if (const auto tile = readTile(out, plan, id, whole)) {
    status.done.push_back(*tile);
  } else if (isSplit(out, plan, id, whole)) {
    ++status.split;
    for (const TileId& quarter : id.split()) statusOf(out, plan, whole, quarter, status);
  } else {
    status.todo.push_back(id);
    if (auto poison = readPoison(out, id)) status.poison.push_back(*std::move(poison));
  }
}

}  // namespace

std::vector<Tile> run(const Job& job, const Binned& rays, const TileId& which, const RunLimits& limits,
                      const Watch& watch) {
  io::checkWriteOptions(limits.files);
  const auto whole = std::find_if(rays.returns_of.begin(), rays.returns_of.end(),
                                  [&](const TileReturns& tile) { return tile.id == which.whole(); });
  if (whole == rays.returns_of.end()) {
    throw InvalidArgument("usage.tile", which.name(), "is no tile of this plan", "See accessvdb tile list");
  }
  if (!which.quarters.empty() && goesSideBySide(job.params)) {
    throw InvalidArgument("usage.tile", which.name(), "is a quarter, but what has gone takes whole tiles",
                          "See accessvdb tile list");
  }
  if (!which.quarters.empty() && !isLargeEnough(job.plan, edgeOf(job.plan, which))) {
    throw InvalidArgument("usage.tile", which.name(), "is smaller than the smallest quarter that the tool allows",
                          "See accessvdb tile list");
  }
  const Run one = {job, limits, watch, *whole, rays.inputs};
  // Who asks for a quarter has seen that the whole does not fit.
  for (std::size_t levels = 0; levels < which.quarters.size(); ++levels) {
    const TileId parent = {which.x, which.y, which.quarters.substr(0, levels)};
    if (isSplit(job.out, job.plan, parent, *whole)) continue;
    whilePlanned(one, which, [&] { markSplit(job.out, job.plan, parent, *whole); });
  }
  std::vector<Tile> done;
  try {
    runInto(one, which, done);
  } catch (const Stopped&) {
  }
  return done;
}

Status status(const fs::path& out, const Plan& plan, const Binned& rays) {
  Status status;
  for (const TileReturns& tile : rays.returns_of) statusOf(out, plan, tile, tile.id, status);
  return status;
}

}  // namespace accessvdb::tiles
