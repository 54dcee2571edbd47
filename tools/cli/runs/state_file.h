// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The saved state that a verb works on.
#pragma once

#include <filesystem>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "options/command_line.h"
#include "options/map_options.h"

namespace accessvdb::tools {

/// What to do about a state that is not the one of its state.json.
struct ChangedState {
  bool allowed;  ///< by --allow-changed: a warning
  Messages& messages;
};

/// The state in the folder of a checkpoint, or the file itself. @param id  of the error if the folder holds none
/// @param why  what cannot be done without: "no direction can be tried again"
/// @throws InputError "output.changed", and as inspectState()
[[nodiscard]] std::filesystem::path stateFile(const std::string& map, const std::string& id, const std::string& why,
                                              const ChangedState& changed);

/// The field of a state, with its labels up to date. @throws InvalidArgument without a tool; as loadState()
[[nodiscard]] AccessibilityField loadField(const std::filesystem::path& state, const MapOptions& tools,
                                           const CommonOptions& common, Messages& messages);

}  // namespace accessvdb::tools
