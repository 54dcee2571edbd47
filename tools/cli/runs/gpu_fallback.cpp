// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/gpu_fallback.h"

#include <string>

namespace accessvdb::tools {

void sayWhyNotOnGpu(const AccessibilityField& field, Messages& messages) {
  const std::string id = field.deviceNoteId(), text = "device: cpu, because " + field.deviceNote();
  if (id.empty()) return;
  if (id == "device.no_driver" || id == "device.not_built") {
    messages.notice(text);
  } else {
    messages.warning(id, text);
  }
}

void requireGpuAskedFor(BackendKind backend) {
  if (backend != BackendKind::Cuda) return;
  FieldParams small;
  small.backend = backend;
  small.threads = 1;
  small.tsdf.voxel_size_m = 0.1;
  small.approach.num_directions = 4;
  static_cast<void>(AccessibilityField(ToolGeometry::builtin("builtin:pencil"), small));
}

void sayWhatNeedsGpu(const MapOptions& options, const AccessibilityField* field, Messages& messages) {
  if (field != nullptr && isGpu(field->deviceName())) return;
  const auto say = [&](const std::string& flag) {
    messages.notice(flag + " has no effect " + (field == nullptr ? "in tiles" : "without a GPU"));
  };
  if (options.host_fusion) say("--host-fusion");
  if (!options.max_device_memory.empty()) say("--max-device-memory");
}

void sayWhatBecameOfGpu(const AccessibilityField& field, RunReport& report, Messages& messages) {
  const std::string id = field.deviceNoteId();
  if (id == report.device_note_id) return;
  report.device_note_id = id;
  report.device_note = field.deviceNote();
  messages.warning(id, "device: " + report.device_note);
}

}  // namespace accessvdb::tools
