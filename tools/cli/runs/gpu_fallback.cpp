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

}  // namespace accessvdb::tools
