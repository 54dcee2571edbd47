// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Checks before any .vdb file is read: OpenVDB 10.0.1 can crash, hang or print on a damaged file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "io/streams/guarded_child.h"

namespace accessvdb::internal {

/// Checks for a regular file that begins like a .vdb. @throws InputError. @returns its size in bytes
std::uint64_t checkVdbFile(const std::filesystem::path& path);

/// Time and memory that reading a .vdb of this size may take.
[[nodiscard]] ChildLimits limitsForVdb(std::uint64_t file_bytes);

/// Text of a foreign exception: one line, printable, at most 200 characters (a file can make it any length).
[[nodiscard]] std::string clampedText(const std::string& text);

/// What a .vdb file contains, as a phrase: `level set "torus" (float) and 1 more, by Houdini`. Reads it as
/// io::summarizeVdb() does. Never throws for a damaged file; reports it instead.
[[nodiscard]] std::string vdbInWords(const std::filesystem::path& path);

}  // namespace accessvdb::internal
