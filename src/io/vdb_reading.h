// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The gate in front of every .vdb that is read: OpenVDB 10.0.1 can crash, hang or print on a damaged file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "io/guarded_child.h"

namespace accessvdb::internal {

/// A regular file that begins as a .vdb does. @throws InputError. @returns its size in bytes
std::uint64_t checkVdbFile(const std::filesystem::path& path);

/// Time and memory that reading a .vdb of this size may take.
[[nodiscard]] ChildLimits limitsForVdb(std::uint64_t file_bytes);

/// Text of a foreign exception: one line, printable, at most 200 characters (a file can make it any length).
[[nodiscard]] std::string clampedText(const std::string& text);

/// What a .vdb file holds, in half a line: `level set "torus" (float) and 1 more, by Houdini`. Reads it as
/// io::summarizeVdb() does. Never throws for a damaged file; says so instead.
[[nodiscard]] std::string vdbInWords(const std::filesystem::path& path);

}  // namespace accessvdb::internal
