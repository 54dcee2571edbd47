// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/state/field_state.h"

#include "accessvdb/config.h"
#include "field/frame_loop.h"
#include "field/state/rules_version.h"
#include "field/state/state_writer.h"

namespace accessvdb::internal {
namespace {

StateHead headOf(const FieldStages& field) {
  StateHead head;
  head.rules_version = kRulesVersion;
  head.version = ACCESSVDB_VERSION;
  head.tool_sha256 = toolListSha256(field.tools.specs());
  head.tools = field.tools.saved();
  head.params = field.params;
  if (field.gate.hasOrigin()) head.origin_W = field.gate.origin_W();
  head.updated = field.labels.updated;
  head.scans = field.labels.scans;
  head.latest_stamp_s = field.clock.latest_s();
  if (field.map.agesFreeSpace()) head.age_s = field.map.generations()->age_s();
  return head;
}

/// Of all tools, if what the last update found out is still true of the map, and all on the host.
std::vector<const PointScorer*> currentScorers(const FieldStages& field) {
  std::vector<const PointScorer*> scorers;
  if (!field.labels.updated || !field.labels.current || field.labels.backlog > 0) return {};
  for (const auto& tool : field.tools) {
    if (!tool->scorer->keepsAllOnHost()) return {};
    scorers.push_back(tool->scorer.get());
  }
  return scorers;
}

/// @return false if the labels have to be made again
bool restoreLabels(FieldStages& field, StateReader& state) {
  if (!state.head().isScored()) return false;
  std::vector<PointScorer*> scorers;
  bool on_host = true;
  for (const auto& tool : field.tools) on_host = on_host && tool->scorer->keepsAllOnHost();
  if (on_host) {
    for (const auto& tool : field.tools) {
      tool->scorer->grow();
      scorers.push_back(tool->scorer.get());
    }
  }
  state.readScored(scorers);
  if (!on_host || !field.scheduler->noteScored()) return false;
  publishWithheld(field);
  field.labels.updated = field.labels.current = true;
  return true;
}

}  // namespace

void saveState(const FieldStages& field, const std::filesystem::path& file, io::WriteFile write) {
  StateInputs parts = {field.map, field.tools.stores(), {}, field.left_out_points, currentScorers(field)};
  if (field.gone_cells) parts.gone = GoneState{field.gone_cells.get(), &field.gone_points};
  writeState(file, headOf(field), parts, write);
}

void restoreState(FieldStages& field, StateReader& state) {
  const StateHead& head = state.head();
  field.stopLeading();  // what a saved map holds is not on the device
  if (head.origin_W) field.gate.restoreOrigin(*head.origin_W);
  state.readInto(field.map, field.tools.stores(), [&](auto facts, auto leaves) { field.mirrors.take(facts, leaves); });
  if (field.gone_cells) state.readGone(*field.gone_cells, field.gone_points);
  field.left_out.restore(state, field.mirrors);
  const bool scored = restoreLabels(field, state);
  if (!scored) field.scheduler->noteRestored();
  field.leadAgain();
  field.labels.scans = head.scans;
  field.clock = FieldClock(head.latest_stamp_s);
  if (field.map.agesFreeSpace()) field.map.generations()->restoreAge(head.age_s);
  while (head.updated && !scored && updateLabels(field).backlog > 0) {
  }
}

}  // namespace accessvdb::internal
