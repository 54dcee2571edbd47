// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What can be written as a file, asked before work begins.
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <filesystem>

#include "accessvdb/export.h"

namespace accessvdb::io {

/// Whether a path is /dev/null or what the process has as standard output: written in place, and never replaced.
[[nodiscard]] ACCESSVDB_API bool isStream(const std::filesystem::path& path);

/// Nothing is there yet, or a regular file that can be replaced, or isStream(). Every writer of files checks it again.
/// @throws OutputError "output.is_folder"; "output.not_a_file" for pipes, sockets and devices, which could block
ACCESSVDB_API void requireOutputFile(const std::filesystem::path& path);

/// For handlers of signals that end the process: deletes the temporary files that are being written. What they were to
/// replace stays as it is.
ACCESSVDB_API void removeUnfinishedFiles() noexcept;

}  // namespace accessvdb::io
