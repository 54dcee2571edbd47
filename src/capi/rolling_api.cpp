// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fields of any extent in C.
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/c_api.h"
#include "accessvdb/error.h"
#include "accessvdb/rolling_field.h"
#include "capi/arrays_in.h"
#include "capi/boundary.h"
#include "capi/frame_stats_out.h"
#include "capi/handles.h"
#include "capi/params_from_c.h"
#include "capi/points_out.h"
#include "capi/tools_from_c.h"
#include "capi/update_stats_out.h"

namespace capi = accessvdb::capi;
using accessvdb::InvalidArgument;
using accessvdb::RollingField;
using accessvdb::RollingStatus;
using accessvdb::capi::onRolling;

namespace {

// Sizes of the first versions.
constexpr std::size_t kOptionsBytes1 = sizeof(accessvdb_rolling_options);
constexpr std::size_t kStatusBytes1 = sizeof(accessvdb_rolling_status);

accessvdb::RollingOptions optionsFromC(const accessvdb_rolling_options& c) {
  capi::requireText("options.folder", c.folder, "Name the folder for tiles that leave memory");
  accessvdb::RollingOptions options;
  options.folder = c.folder;
  options.memory_limit_bytes = c.memory_limit_bytes;
  options.device_limit_bytes = c.device_limit_bytes;
  options.tile_voxels = c.tile_voxels;
  options.notes_changes = capi::requireBool("options.notes_changes", c.notes_changes);
  return options;
}

accessvdb_rolling_status statusToC(const RollingStatus& now) {
  accessvdb_rolling_status c = {};
  c.memory_short = now.memory_short;
  c.tile_voxels = now.tile_voxels;
  c.margin_voxels = now.margin_voxels;
  c.steps = now.steps;
  c.points = now.points;
  c.tiles = now.tiles;
  c.tiles_in_memory = now.tiles_in_memory;
  c.saved = now.saved;
  c.loaded = now.loaded;
  c.saved_ahead = now.saved_ahead;
  c.loaded_ahead = now.loaded_ahead;
  c.memory_bytes = now.memory_bytes;
  c.device_bytes = now.device_bytes;
  c.peak_memory_bytes = now.peak_memory_bytes;
  c.left_out_returns = now.left_out_returns;
  c.lost_tile_count = now.lost_tiles.size();
  c.fitting_range_m = now.fitting_range_m;
  c.unsaved = now.unsaved;
  return c;
}

}  // namespace

int accessvdb_rolling_create(const accessvdb_tool_spec* tools, std::size_t spec_size, std::size_t tool_count,
                             const accessvdb_params* params, const accessvdb_rolling_options* options,
                             accessvdb_rolling** rolling, accessvdb_error* error) noexcept {
  if (rolling != nullptr) *rolling = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("rolling", rolling);
    const auto c = capi::readSized("options", options, kOptionsBytes1, accessvdb_rolling_options{});
    accessvdb::RollingOptions given = optionsFromC(c);
    const bool resume = capi::requireBool("options.resume", c.resume);
    std::vector<accessvdb::ToolSpec> specs = capi::toolsFromC(tools, spec_size, tool_count);
    const accessvdb::FieldParams of_all = capi::paramsOrDefaults(params);
    if (!of_all.carry.empty()) {
      throw accessvdb::InvalidArgument("rolling.params", "params", "carry attributes, which no call brings here",
                                       "Leave them out");
    }
    *rolling =
        std::make_unique<accessvdb_rolling>(resume ? RollingField::resume(std::move(specs), of_all, std::move(given))
                                                   : RollingField(std::move(specs), of_all, std::move(given)))
            .release();
  });
}

int accessvdb_rolling_has_checkpoint(const char* folder, std::int32_t* found, accessvdb_error* error) noexcept {
  if (found != nullptr) *found = 0;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("found", found);
    capi::requireText("folder", folder, "Name the folder of a rolling field");
    *found = RollingField::hasCheckpoint(folder) ? 1 : 0;
  });
}

void accessvdb_rolling_free(accessvdb_rolling* rolling) noexcept {
  capi::freeHandle(capi::isRolling(rolling), rolling);
}

const char* accessvdb_rolling_error_text(const accessvdb_rolling* rolling) noexcept {
  return capi::isRolling(rolling) ? rolling->error.text
                                  : "this is not a rolling field. Make one with accessvdb_rolling_create.";
}

const char* accessvdb_rolling_error_id(const accessvdb_rolling* rolling) noexcept {
  return capi::isRolling(rolling) ? rolling->error.id : "c_api.handle";
}

int accessvdb_rolling_integrate_scan_at(accessvdb_rolling* rolling, const float* points_S, std::size_t point_count,
                                        const double* T_W_S, double stamp_s, accessvdb_frame_stats* stats) noexcept {
  return onRolling(rolling, [&] {
    const capi::FrameStatsOut out(stats);
    const auto points = capi::vectors("points_S", points_S, point_count);
    out.write(rolling->field.integrateScan(points, capi::poseFromC(T_W_S), stamp_s));
  });
}

int accessvdb_rolling_integrate_rays_at(accessvdb_rolling* rolling, const double* points_W, std::size_t point_count,
                                        const double* origins_W, std::size_t origin_count, double stamp_s,
                                        accessvdb_frame_stats* stats) noexcept {
  return onRolling(rolling, [&] {
    const capi::FrameStatsOut out(stats);
    const auto points = capi::vectors("points_W", points_W, point_count);
    const auto origins = capi::vectors("origins_W", origins_W, origin_count);
    out.write(rolling->field.integrateRays(points, origins, stamp_s));
  });
}

int accessvdb_rolling_leave_out(accessvdb_rolling* rolling, const double* centres_W, std::size_t count,
                                double radius_m) noexcept {
  return onRolling(rolling, [&] { rolling->field.leaveOut(capi::vectors("centres_W", centres_W, count), radius_m); });
}

int accessvdb_rolling_update(accessvdb_rolling* rolling, accessvdb_update_stats* stats) noexcept {
  return onRolling(rolling, [&] {
    const capi::UpdateStatsOut out(stats);
    out.write(rolling->field.update());
  });
}

int accessvdb_rolling_take_snapshot(accessvdb_rolling* rolling, std::size_t* point_count) noexcept {
  return capi::takeSnapshot(capi::isRolling(rolling), rolling, point_count, [&] { return rolling->field.snapshot(); });
}

int accessvdb_rolling_take_snapshot_in_memory(accessvdb_rolling* rolling, std::size_t* point_count) noexcept {
  return capi::takeSnapshot(capi::isRolling(rolling), rolling, point_count,
                            [&] { return rolling->field.snapshotInMemory(); });
}

int accessvdb_rolling_copy_points(accessvdb_rolling* rolling, std::size_t first, std::size_t count,
                                  accessvdb_point* points, std::size_t point_size) noexcept {
  return onRolling(rolling, [&] {
    const auto& taken = capi::takenSnapshot(rolling->snapshot, "accessvdb_rolling_take_snapshot");
    capi::copyPoints(taken.points, {first, count}, points, point_size);
  });
}

int accessvdb_rolling_drop_snapshot(accessvdb_rolling* rolling) noexcept {
  return onRolling(rolling, [&] { rolling->snapshot.reset(); });
}

int accessvdb_rolling_take_changed(accessvdb_rolling* rolling, std::size_t* point_count) noexcept {
  if (point_count != nullptr) *point_count = 0;
  return onRolling(rolling, [&] {
    rolling->changed = rolling->field.takeChanged();
    if (point_count != nullptr) *point_count = rolling->changed.size();
  });
}

int accessvdb_rolling_copy_changed(accessvdb_rolling* rolling, std::size_t first, std::size_t count,
                                   accessvdb_point* points, std::size_t point_size) noexcept {
  return onRolling(rolling, [&] { capi::copyPoints(rolling->changed, {first, count}, points, point_size); });
}

int accessvdb_rolling_get_status(accessvdb_rolling* rolling, accessvdb_rolling_status* status) noexcept {
  return onRolling(rolling, [&] {
    const std::size_t size = capi::checkedSize("status", status, kStatusBytes1);
    RollingStatus now = rolling->field.status();
    capi::writeSized(status, size, statusToC(now));
    rolling->lost_tiles = std::move(now.lost_tiles);
  });
}

const char* accessvdb_rolling_lost_tile(const accessvdb_rolling* rolling, std::size_t index) noexcept {
  if (!capi::isRolling(rolling) || index >= rolling->lost_tiles.size()) return "";
  return rolling->lost_tiles[index].c_str();
}

int accessvdb_rolling_checkpoint(accessvdb_rolling* rolling, const char* note) noexcept {
  return onRolling(rolling, [&] { rolling->field.checkpoint(note != nullptr ? note : ""); });
}

const char* accessvdb_rolling_note(const accessvdb_rolling* rolling) noexcept {
  return capi::isRolling(rolling) ? rolling->field.note().c_str() : "";
}

int accessvdb_rolling_tighten(accessvdb_rolling* rolling, double share) noexcept {
  return onRolling(rolling, [&] {
    if (!(share >= 0 && share <= 1)) {
      throw InvalidArgument("c_api.value", "share", "must be 0 .. 1", "Pass 1 for the limits as they were given");
    }
    rolling->field.tighten(share);
  });
}

int accessvdb_rolling_write(accessvdb_rolling* rolling, const char* folder) noexcept {
  return onRolling(rolling, [&] {
    capi::requireText("folder", folder, "Name the output folder");
    rolling->field.write(folder);
  });
}
