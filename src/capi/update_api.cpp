// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Updates that do not block, in C.
#include <memory>
#include <utility>

#include "accessvdb/c_api.h"
#include "accessvdb/update_ticket.h"
#include "capi/boundary.h"
#include "capi/handles.h"
#include "capi/update_stats_out.h"

namespace capi = accessvdb::capi;

int accessvdb_field_update_async(accessvdb_field* field, accessvdb_update** update) noexcept {
  if (update != nullptr) *update = nullptr;
  return capi::onField(field, [&] {
    capi::requirePointer("update", update);
    auto made = std::make_unique<accessvdb_update>();  // first: once begun, the update must not be lost
    made->ticket = field->field.updateAsync();
    *update = made.release();
  });
}

int accessvdb_update_wait(accessvdb_update* update, accessvdb_update_stats* stats) noexcept {
  return capi::onUpdate(update, [&] {
    const capi::UpdateStatsOut out(stats);
    out.write(update->ticket.wait());
  });
}

int accessvdb_update_is_done(accessvdb_update* update, std::int32_t* done) noexcept {
  if (done != nullptr) *done = 0;
  return capi::onUpdate(update, [&] {
    capi::requirePointer("done", done);
    *done = update->ticket.done() ? 1 : 0;
  });
}

const char* accessvdb_update_error_text(const accessvdb_update* update) noexcept {
  return capi::isUpdate(update) ? update->error.text
                                : "this is not an update. Make one with accessvdb_field_update_async.";
}

const char* accessvdb_update_error_id(const accessvdb_update* update) noexcept {
  return capi::isUpdate(update) ? update->error.id : "c_api.handle";
}

void accessvdb_update_free(accessvdb_update* update) noexcept { capi::freeHandle(capi::isUpdate(update), update); }
