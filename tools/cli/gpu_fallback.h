// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a field runs, said once, and why not on a GPU where --device auto was to take one.
#pragma once

#include "accessvdb/accessibility_field.h"
#include "error_output.h"

namespace accessvdb::tools {

/// Nothing on a GPU or with --device cpu. A notice where nobody would expect a GPU (no driver, a build without CUDA),
/// else a warning: there is one, and it is not used.
void sayWhyNotOnGpu(const AccessibilityField& field, Messages& messages);

}  // namespace accessvdb::tools
