// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A run's progress as JSON, for manifests of checkpoints.
#pragma once

#include <nlohmann/json.hpp>

#include "runs/run_progress.h"

namespace accessvdb::tools {

void addProgress(const RunProgress& progress, const Reading& reading, nlohmann::ordered_json& to);
/// @throws nlohmann::json::exception where entries are missing or malformed
[[nodiscard]] RunProgress progressFrom(const nlohmann::ordered_json& json);
[[nodiscard]] Reading readingFrom(const nlohmann::ordered_json& json);

}  // namespace accessvdb::tools
