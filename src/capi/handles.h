// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The objects behind the opaque handles of the C API.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/tool_spec.h"
#include "capi/boundary.h"

namespace accessvdb::capi {

/// First word of a handle, so that a handle of the other kind (or a freed one, as long as its memory is not reused) is
/// detected instead of misread.
inline constexpr std::uint32_t kToolMark = 0x4c4f4f54u, kFieldMark = 0x444c4546u, kUpdateMark = 0x54445055u,
                               kRollingMark = 0x4c4c4f52u, kFreedMark = 0;

}  // namespace accessvdb::capi

struct accessvdb_tool {
  explicit accessvdb_tool(accessvdb::ToolGeometry given) : tool(std::move(given)) {}
  std::uint32_t mark = accessvdb::capi::kToolMark;
  accessvdb::ToolGeometry tool;
};

struct accessvdb_field {
  explicit accessvdb_field(accessvdb::AccessibilityField made)
      : field(std::move(made)),
        device(field.deviceName()),
        parameters(accessvdb::describeTools(field.tools(), field.params())) {}
  std::uint32_t mark = accessvdb::capi::kFieldMark;
  std::atomic<bool> busy = false;  ///< a thread is inside a call
  accessvdb_error error = {};      ///< of the last failed call
  accessvdb::AccessibilityField field;
  std::string device, parameters;
  std::optional<accessvdb::FieldSnapshot> snapshot;
  std::vector<accessvdb::SurfacePoint> opened;  ///< of the last what-if
};

struct accessvdb_rolling {
  explicit accessvdb_rolling(accessvdb::RollingField made) : field(std::move(made)) {}
  std::uint32_t mark = accessvdb::capi::kRollingMark;
  std::atomic<bool> busy = false;
  accessvdb_error error = {};
  accessvdb::RollingField field;
  std::optional<accessvdb::FieldSnapshot> snapshot;
  std::vector<accessvdb::SurfacePoint> changed;  ///< of the last accessvdb_rolling_take_changed()
  std::vector<std::string> lost_tiles;           ///< of the last accessvdb_rolling_get_status()
};

struct accessvdb_update {
  std::uint32_t mark = accessvdb::capi::kUpdateMark;
  std::atomic<bool> busy = false;
  accessvdb_error error = {};
  accessvdb::UpdateTicket ticket;
};

namespace accessvdb::capi {

[[nodiscard]] inline bool isTool(const accessvdb_tool* handle) {
  return handle != nullptr && handle->mark == kToolMark;
}
[[nodiscard]] inline bool isField(const accessvdb_field* handle) {
  return handle != nullptr && handle->mark == kFieldMark;
}
[[nodiscard]] inline bool isRolling(const accessvdb_rolling* handle) {
  return handle != nullptr && handle->mark == kRollingMark;
}
[[nodiscard]] inline bool isUpdate(const accessvdb_update* handle) {
  return handle != nullptr && handle->mark == kUpdateMark;
}

/// Runs `body` on a handle that no other thread is using, and stores its error text.
template <typename Handle, typename Body>
int onHandle(bool valid, Handle* handle, const Body& body) noexcept {
  if (!valid || handle->busy.exchange(true, std::memory_order_acquire)) return ACCESSVDB_ERROR_USAGE;
  const int code = guarded(handle->error, body);
  handle->busy.store(false, std::memory_order_release);
  return code;
}
template <typename Body>
int onField(accessvdb_field* field, const Body& body) noexcept {
  return onHandle(isField(field), field, body);
}
template <typename Body>
int onRolling(accessvdb_rolling* rolling, const Body& body) noexcept {
  return onHandle(isRolling(rolling), rolling, body);
}
template <typename Body>
int onUpdate(accessvdb_update* update, const Body& body) noexcept {
  return onHandle(isUpdate(update), update, body);
}

/// Has a handle keep the snapshot that `take` returns. @param point_count  out, may be null
template <typename Handle, typename Take>
int takeSnapshot(bool valid, Handle* handle, std::size_t* point_count, const Take& take) noexcept {
  if (point_count != nullptr) *point_count = 0;
  return onHandle(valid, handle, [&] {
    handle->snapshot.reset();  // avoids two at once
    handle->snapshot = take();
    if (point_count != nullptr) *point_count = handle->snapshot->points.size();
  });
}

template <typename Handle>
void freeHandle(bool valid, Handle* handle) noexcept {
  if (!valid) return;
  handle->mark = kFreedMark;
  delete handle;
}

}  // namespace accessvdb::capi
