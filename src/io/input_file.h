// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reading an input file whole, after the checks that make that safe: a regular file, not empty, not a Git LFS
/// pointer, and of the same size at the end as at the beginning. No mapping: a file that shrinks must not be a signal.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace accessvdb::io {

/// File text or a path made fit for a message: control bytes escaped, clamped.
[[nodiscard]] std::string forMessage(std::string_view text, std::size_t max_bytes = 1024);
/// The same for one word of a file.
[[nodiscard]] inline std::string wordForMessage(std::string_view word) { return forMessage(word, 64); }

/// Size of a regular file in bytes. @throws InputError (missing, folder, pipe, device, no permission)
[[nodiscard]] std::uint64_t inputFileSize(const std::filesystem::path& path);

/// Content of the file, at most max_bytes from its beginning.
/// @throws InputError (as inputFileSize; empty, Git LFS pointer, changed while it was read)
[[nodiscard]] std::string readInputFile(const std::filesystem::path& path, std::uint64_t max_bytes = UINT64_MAX);

/// How many of the promised records can be read from the bytes at hand. Never multiplies what the file says.
/// @param record_bytes  > 0
/// @param[out] missing  promised records that the file lacks
/// @throws InputError "input.truncated" naming both byte counts, unless allow_truncated
[[nodiscard]] std::uint64_t recordsAvailable(const std::string& subject, std::uint64_t promised,
                                             std::uint64_t record_bytes, std::uint64_t available_bytes,
                                             bool allow_truncated, std::uint64_t& missing);

}  // namespace accessvdb::io
