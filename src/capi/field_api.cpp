// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fields in C.
#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "capi/arrays_in.h"
#include "capi/boundary.h"
#include "capi/frame_stats_out.h"
#include "capi/handles.h"
#include "capi/params_from_c.h"
#include "capi/points_out.h"
#include "capi/update_stats_out.h"

namespace capi = accessvdb::capi;
using accessvdb::AccessibilityField;
using accessvdb::InvalidArgument;
using accessvdb::SurfacePoint;
using accessvdb::capi::onField;

namespace {

constexpr std::size_t kCountsBytes1 = 96;  ///< size of the first version
static_assert(sizeof(accessvdb_counts) >= kCountsBytes1);

std::span<const std::int32_t> valuesOf(const std::int32_t* attributes, std::size_t count) {
  capi::requireArray("attributes", attributes, count, sizeof(std::int32_t), alignof(std::int32_t));
  return {attributes, count};
}

const accessvdb::FieldSnapshot& takenFrom(const accessvdb_field* field) {
  return capi::takenSnapshot(field->snapshot, "accessvdb_field_take_snapshot");
}

}  // namespace

int accessvdb_params_defaults(accessvdb_params* params) noexcept {
  accessvdb_error unread = {};
  return capi::guarded(unread, [&] {
    const std::size_t size = capi::checkedSize("params", params, capi::kParamsBytes1);
    capi::writeSized(params, size, capi::paramsToC({}));
  });
}

int accessvdb_params_paper(double voxel_size_m, accessvdb_params* params) noexcept {
  accessvdb_error unread = {};
  return capi::guarded(unread, [&] {
    const std::size_t size = capi::checkedSize("params", params, capi::kParamsBytes1);
    const accessvdb::FieldParams paper = accessvdb::FieldParams::paper(voxel_size_m);
    static_cast<void>(paper.resolved());  // checks the voxel size early
    capi::writeSized(params, size, capi::paramsToC(paper));
  });
}

int accessvdb_field_create(const accessvdb_tool* tool, const accessvdb_params* params, accessvdb_field** field,
                           accessvdb_error* error) noexcept {
  if (field != nullptr) *field = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("field", field);
    if (!capi::isTool(tool)) throw InvalidArgument("c_api.handle", "tool", "is not a tool", "Make one first");
    *field =
        std::make_unique<accessvdb_field>(AccessibilityField(tool->tool, capi::paramsOrDefaults(params))).release();
  });
}

void accessvdb_field_free(accessvdb_field* field) noexcept { capi::freeHandle(capi::isField(field), field); }

const char* accessvdb_field_error_text(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->error.text : "this is not a field. Make one with accessvdb_field_create.";
}

const char* accessvdb_field_error_id(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->error.id : "c_api.handle";
}

int accessvdb_field_integrate_scan(accessvdb_field* field, const float* points_S, std::size_t point_count,
                                   const double* T_W_S, accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const capi::FrameStatsOut out(stats);
    const auto points = capi::vectors("points_S", points_S, point_count);
    out.write(field->field.integrateScan(points, capi::poseFromC(T_W_S)));
  });
}

int accessvdb_field_integrate_scan_at(accessvdb_field* field, const float* points_S, std::size_t point_count,
                                      const double* T_W_S, double stamp_s, accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const capi::FrameStatsOut out(stats);
    const auto points = capi::vectors("points_S", points_S, point_count);
    out.write(field->field.integrateScan(points, capi::poseFromC(T_W_S), stamp_s));
  });
}

int accessvdb_field_integrate_rays(accessvdb_field* field, const double* points_W, std::size_t point_count,
                                   const double* origins_W, std::size_t origin_count,
                                   accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const capi::FrameStatsOut out(stats);
    const auto points = capi::vectors("points_W", points_W, point_count);
    out.write(field->field.integrateRays(points, capi::vectors("origins_W", origins_W, origin_count)));
  });
}

int accessvdb_field_integrate_rays_at(accessvdb_field* field, const double* points_W, std::size_t point_count,
                                      const double* origins_W, std::size_t origin_count, double stamp_s,
                                      accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const capi::FrameStatsOut out(stats);
    const auto points = capi::vectors("points_W", points_W, point_count);
    const auto origins = capi::vectors("origins_W", origins_W, origin_count);
    out.write(field->field.integrateRays(points, origins, stamp_s));
  });
}

int accessvdb_field_integrate_scan_carrying(accessvdb_field* field, const float* points_S, std::size_t point_count,
                                            const double* T_W_S, double stamp_s, const std::int32_t* attributes,
                                            std::size_t attribute_count, accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const capi::FrameStatsOut out(stats);
    const auto points = capi::vectors("points_S", points_S, point_count);
    const auto values = valuesOf(attributes, attribute_count);
    out.write(field->field.integrateScan(points, capi::poseFromC(T_W_S), stamp_s, values));
  });
}

int accessvdb_field_integrate_rays_carrying(accessvdb_field* field, const double* points_W, std::size_t point_count,
                                            const double* origins_W, std::size_t origin_count, double stamp_s,
                                            const std::int32_t* attributes, std::size_t attribute_count,
                                            accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const capi::FrameStatsOut out(stats);
    const auto points = capi::vectors("points_W", points_W, point_count);
    const auto origins = capi::vectors("origins_W", origins_W, origin_count);
    const auto values = valuesOf(attributes, attribute_count);
    out.write(field->field.integrateRays(points, origins, stamp_s, values));
  });
}

int accessvdb_field_copy_attribute(accessvdb_field* field, std::size_t column, std::size_t first, std::size_t count,
                                   std::int32_t* values) noexcept {
  return onField(field, [&] {
    const std::vector<accessvdb::AttributeColumn>& columns = takenFrom(field).attributes;
    if (column >= columns.size()) {
      throw InvalidArgument("carry.column", std::to_string(column),
                            "is not one of the " + std::to_string(columns.size()) + " attributes of this field",
                            "Count the names in accessvdb_params::carry from 0");
    }
    const std::vector<std::int32_t>& all = columns[column].values;
    capi::requireArray("values", values, count, sizeof(std::int32_t), alignof(std::int32_t));
    if (first > all.size() || count > all.size() - first) {
      throw InvalidArgument(
          "snapshot.range", "",
          std::to_string(count) + " points from " + std::to_string(first) + " on, of " + std::to_string(all.size()),
          "Stay within the snapshot");
    }
    std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(first), count, values);
  });
}

int accessvdb_field_latest_stamp(accessvdb_field* field, double* stamp_s) noexcept {
  return onField(field, [&] {
    capi::requirePointer("stamp_s", stamp_s);
    *stamp_s = field->field.latestStamp_s().value_or(std::numeric_limits<double>::quiet_NaN());
  });
}

int accessvdb_field_tool_share_hidden(accessvdb_field* field, double* share) noexcept {
  return onField(field, [&] {
    capi::requirePointer("share", share);
    *share = field->field.toolShareHidden();
  });
}

int accessvdb_field_update(accessvdb_field* field, accessvdb_update_stats* stats) noexcept {
  return onField(field, [&] {
    const capi::UpdateStatsOut out(stats);
    out.write(field->field.update());
  });
}

int accessvdb_field_take_snapshot(accessvdb_field* field, std::size_t* point_count) noexcept {
  return capi::takeSnapshot(capi::isField(field), field, point_count, [&] { return field->field.snapshot(); });
}

int accessvdb_field_copy_points(accessvdb_field* field, std::size_t first, std::size_t count, accessvdb_point* points,
                                std::size_t point_size) noexcept {
  return onField(field, [&] { capi::copyPoints(takenFrom(field).points, {first, count}, points, point_size); });
}

int accessvdb_field_get_counts(accessvdb_field* field, accessvdb_counts* counts) noexcept {
  return onField(field, [&] {
    const std::size_t size = capi::checkedSize("counts", counts, kCountsBytes1);
    const accessvdb::FieldSnapshot& snapshot = takenFrom(field);
    accessvdb_counts c = {};
    c.points = snapshot.points.size();
    for (const SurfacePoint& point : snapshot.points) {
      ++c.labels[static_cast<std::size_t>(point.label)];
      switch (point.reason) {
        case accessvdb::PointReason::Changed:
          ++c.changed;
          break;
        case accessvdb::PointReason::BesideSurface:
          ++c.beside_surface;
          break;
        default:
          ++c.reasons[static_cast<std::size_t>(point.reason)];
      }
    }
    capi::writeSized(counts, size, c);
  });
}

int accessvdb_field_drop_snapshot(accessvdb_field* field) noexcept {
  return onField(field, [&] { field->snapshot.reset(); });
}

int accessvdb_field_point_at(accessvdb_field* field, const double* p_W, accessvdb_point* point, std::size_t point_size,
                             std::int32_t* found) noexcept {
  if (found != nullptr) *found = 0;
  return onField(field, [&] {
    capi::requirePointer("found", found);
    capi::requireArray("p_W", p_W, 3, sizeof(double), alignof(double));
    capi::requireSize("point_size", point_size, capi::kPointBytes1);
    capi::requirePointer("point", point);
    const std::optional<SurfacePoint> answer = field->field.pointAt(Eigen::Vector3d(p_W));
    if (!answer) return;
    capi::writePoint(point, point_size, *answer);
    *found = 1;
  });
}

const char* accessvdb_field_device(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->device.c_str() : "";
}

const char* accessvdb_field_parameters(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->parameters.c_str() : "";
}

int accessvdb_field_write(accessvdb_field* field, const char* folder) noexcept {
  return onField(field, [&] {
    capi::requireText("folder", folder, "Name the output folder");
    field->field.write(folder);
  });
}

int accessvdb_field_save_state(accessvdb_field* field, const char* file) noexcept {
  return onField(field, [&] {
    capi::requireText("file", file, "Name the file of the state");
    field->field.saveState(file);
  });
}

int accessvdb_field_load_state(const char* file, const accessvdb_tool* tool, std::int32_t backend, std::int32_t threads,
                               accessvdb_field** field, accessvdb_error* error) noexcept {
  if (field != nullptr) *field = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("field", field);
    capi::requireText("file", file, "Name the file of the state");
    if (!capi::isTool(tool)) throw InvalidArgument("c_api.handle", "tool", "is not a tool", "Make one first");
    const accessvdb::BackendKind kind = capi::backendFromC(backend);
    *field =
        std::make_unique<accessvdb_field>(AccessibilityField::loadState(file, tool->tool, kind, threads)).release();
  });
}
