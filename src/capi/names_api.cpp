// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Versions and names of the C API.
#include "accessvdb/c_api.h"
#include "accessvdb/config.h"
#include "accessvdb/point_label.h"
#include "accessvdb/types.h"

// The numbers in C equal those in C++.
static_assert(ACCESSVDB_NUM_LABELS == accessvdb::kNumPointLabels);
static_assert(ACCESSVDB_NUM_REASONS == ACCESSVDB_REASON_CHANGED);  // an array in a struct of version 1 has this length
static_assert(ACCESSVDB_REASON_CHANGED == static_cast<int>(accessvdb::PointReason::Changed));
static_assert(ACCESSVDB_REASON_BESIDE_SURFACE == static_cast<int>(accessvdb::PointReason::BesideSurface));
static_assert(ACCESSVDB_REASON_BESIDE_SURFACE + 1 == accessvdb::kNumPointReasons);
static_assert(ACCESSVDB_NUM_DROP_REASONS == accessvdb::kNumDropReasons);
static_assert(ACCESSVDB_BLOCKED == static_cast<int>(accessvdb::PointLabel::Blocked));
static_assert(ACCESSVDB_REASON_TOOL == static_cast<int>(accessvdb::PointReason::Tool));

const char* accessvdb_version(void) noexcept { return ACCESSVDB_VERSION; }

std::uint32_t accessvdb_c_api_version(void) noexcept { return ACCESSVDB_C_API_VERSION; }

const char* accessvdb_label_name(std::int32_t label) noexcept {
  if (label < 0 || label >= accessvdb::kNumPointLabels) return "?";
  return accessvdb::name(static_cast<accessvdb::PointLabel>(label));
}

const char* accessvdb_reason_name(std::int32_t reason) noexcept {
  if (reason < 0 || reason >= accessvdb::kNumPointReasons) return "?";
  return accessvdb::name(static_cast<accessvdb::PointReason>(reason));
}
