// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reports where a field runs, why --device auto did not choose a GPU, and what became of it.
#pragma once

#include "accessvdb/accessibility_field.h"
#include "options/map_options.h"
#include "output/error_output.h"
#include "output/report.h"

namespace accessvdb::tools {

/// Prints nothing on a GPU or with --device cpu. Otherwise a notice if no GPU can be expected (no driver, a build
/// without CUDA), else a warning: there is one, but it is not used.
void sayWhyNotOnGpu(const AccessibilityField& field, Messages& messages);
/// Fails as a field would if a GPU was asked for and cannot be used, before anything large is read.
void requireGpuAskedFor(BackendKind backend);
/// Names flags that were given and change nothing without a GPU, or in tiles. @param field  null: in tiles
void sayWhatNeedsGpu(const MapOptions& options, const AccessibilityField* field, Messages& messages);
/// At the end: warns if the map on the GPU had to be made again, and puts it into the report.
void sayWhatBecameOfGpu(const AccessibilityField& field, RunReport& report, Messages& messages);

}  // namespace accessvdb::tools
