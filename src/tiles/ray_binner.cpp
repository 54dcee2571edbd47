// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One pass over the scans: the returns that pass the gate, sorted by the tiles that need them.
#include <algorithm>
#include <set>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "field/scan_gate.h"
#include "tiles/json_file.h"
#include "tiles/own_files.h"
#include "tiles/planned_inputs.h"
#include "tiles/ray_files.h"
#include "tiles/ray_shard.h"
#include "tiles/side_by_side.h"
#include "tiles/step_sorter.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

/// @return number of returns stored, in all tiles
std::uint64_t addTo(ShardBuffer& buffer, std::uint32_t step, StepSorter& sorter, const internal::GatedScan& scan) {
  std::uint64_t stored = 0;
  for (const TileIndex& tile : sorter.sort(scan)) {
    const StepSorter::Returns returns = sorter.returnsOf(tile, scan);
    buffer.add(tile, step, returns.p_L, returns.q_L, returns.attributes);
    stored += returns.p_L.size();
  }
  return stored;
}

/// Reads steps and writes shards.
class Binner {
 public:
  Binner(const Job& job, std::span<io::ScanSequence* const> flights, const Watch& watch)
      : job_(job),
        flights_(flights),
        watch_(watch),
        params_(job.params.resolved()),
        gate_(params_.tsdf, job.plan.origin_W, std::nullopt, params_.carry.size()),
        sorter_(job.plan.tile_voxels, job.plan.margin_voxels, params_.tsdf.voxel_size_m),
        inputs_(job.plan) {}

  /// A shard ends where it is full, and where its flight ends. @return false if stopped
  bool binTo(std::uint64_t begin, std::uint64_t end) {
    std::uint64_t flight_begin = 0;
    for (std::size_t n = 0; n < flights_.size(); ++n) {
      const std::uint64_t flight_end = flight_begin + job_.plan.flights[n].stamps_s.size();
      const std::uint64_t from = std::max(begin, flight_begin), to = std::min(end, flight_end);
      if (from < to && !binFlight(n, flight_begin, from, to)) return false;
      flight_begin = flight_end;
    }
    return true;
  }

  /// All inputs with their hashes. @throws UnusableInput "plan.changed"
  [[nodiscard]] std::vector<io::InputFile> inputs(const std::vector<io::InputFile>& before) const {
    return inputs_.all(job_.out, before);
  }

 private:
  bool binFlight(std::size_t flight, std::uint64_t flight_begin, std::uint64_t begin, std::uint64_t end) {
    const std::string& plan_id = job_.plan.ids[flight];
    ShardIndex index;
    index.first_step = begin;
    for (std::uint64_t step = begin; step < end; ++step) {
      if (watch_.stop()) return false;
      const io::ScanRecord record = flights_[flight]->read(step - flight_begin);
      inputs_.note(record.path);
      add(static_cast<std::uint32_t>(step), record, index);
      index.end_step = step + 1;
      if (buffer_.bytes() >= job_.plan.bin_bytes || step + 1 == end) {
        buffer_.write(raysFolder(job_.out) / shardName(index.first_step), plan_id, std::move(index));
        index = {};
        index.first_step = step + 1;
      }
      watch_.progress(step + 1, job_.plan.steps(), fs::path(record.path).filename().string());
    }
    return true;
  }
  void add(std::uint32_t step, const io::ScanRecord& record, ShardIndex& index) {
    FrameStats stats;
    const std::vector<std::int32_t> attributes = io::attributesFor(record, params_.carry.size());  // of any flight
    const internal::GatedScan& scan = record.points_W.empty()
                                          ? gate_.gate(record.points_S, record.T_W_S, stats, attributes)
                                          : gate_.gate(record.points_W, record.origins_W, stats, attributes);
    if (!scan.p_L.empty()) addTo(buffer_, step, sorter_, scan);
    index.farthest_m.push_back(longestRay_m(scan));
    index.points_in += stats.points_in;
    index.points_used += stats.points_used;
    index.truncated_points += record.truncated_points;
    for (std::size_t n = 0; n < index.dropped.size(); ++n) index.dropped[n] += stats.dropped[n];
  }

  const Job& job_;
  std::span<io::ScanSequence* const> flights_;
  const Watch& watch_;
  FieldParams params_;
  internal::ScanGate gate_;
  StepSorter sorter_;
  ShardBuffer buffer_;
  PlannedInputs inputs_;
};

/// The end of the shards that are whole, from the first step on. Deletes our files after them.
std::uint64_t endOfWhole(const fs::path& out, const Plan& plan) {
  const fs::path folder = raysFolder(out);
  std::set<std::string> whole;
  std::uint64_t step = 0;
  for (bool more = true; more && step < plan.steps();) {
    try {
      const ShardIndex index = readShardIndex(folder / shardName(step), shardPlanId(plan, step));
      more = index.first_step == step && index.end_step > step;
      if (!more) break;
      whole.insert(shardName(step));
      step = index.end_step;
    } catch (const InputError&) {
      more = false;
    }
  }
  std::error_code ignored;
  for (const fs::path& file : ownRays(out).files) {
    if (!whole.contains(file.filename().string())) fs::remove(file, ignored);
  }
  return step;
}

}  // namespace

bool hasRays(const Job& job, const Binned& rays) {
  return goesSideBySide(job.params) ? hasFused(job, rays.inputs) : missingShards(job.out, job.plan).empty();
}

Binned bin(const Job& job, std::span<io::ScanSequence* const> flights, const Watch& watch, const BinLimits& limits) {
  if (flights.size() != job.plan.flights.size()) {
    throw InvalidArgument("usage.flights", "bin", "needs the scans of each flight of the plan");
  }
  const fs::path folder = raysFolder(job.out);
  refuseForeign(ownRays(job.out));
  if (goesSideBySide(job.params)) return passSideBySide(job, flights, watch, limits);
  io::prepareOutputFolder(folder);
  Binner binner(job, flights, watch);
  std::vector<io::InputFile> before;
  if (const auto done = binned(job.out, job.plan)) {
    // Everything was read before: only shards that are gone or damaged are made again.
    const std::vector<ShardRange> missing = missingShards(job.out, job.plan);
    if (missing.empty()) return *done;
    before = done->inputs;
    for (const ShardRange& range : missing) {
      if (!binner.binTo(range.first_step, range.end_step)) return {};
    }
  } else if (!binner.binTo(endOfWhole(job.out, job.plan), job.plan.steps())) {
    return {};
  }
  return writeBinned(job.out, job.plan, binner.inputs(before));
}

}  // namespace accessvdb::tiles
