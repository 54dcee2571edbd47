// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scenes not used to choose any constant of the method, drawn once from a fixed seed (docs/PAPER.md, "Scenes").
#pragma once

#include <optional>
#include <string>

#include "sim/benchmark_scene.h"

namespace accessvdb::sim {

inline constexpr int kUnseenScenes = 6;

/// 4 for "unseen_4"; nothing for any other text.
[[nodiscard]] std::optional<int> unseenNumber(const std::string& name);
/// Scene and path of number 1 .. 6; the poses are not generated yet. @throws InvalidArgument
[[nodiscard]] BenchmarkScene unseenScene(int number);

}  // namespace accessvdb::sim
