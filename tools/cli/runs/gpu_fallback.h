// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reports once where a field runs, and why --device auto did not choose a GPU.
#pragma once

#include "accessvdb/accessibility_field.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// Prints nothing on a GPU or with --device cpu. Otherwise a notice if no GPU can be expected (no driver, a build
/// without CUDA), else a warning: there is one, but it is not used.
void sayWhyNotOnGpu(const AccessibilityField& field, Messages& messages);

}  // namespace accessvdb::tools
