// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads an input file, after the checks that make this safe: a regular file, not empty, not a Git LFS pointer, same
/// size at the end as at the beginning. Not memory-mapped: a file that shrinks must not raise a signal.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace accessvdb::io {

/// File text or a path, made printable for a message: control bytes escaped, truncated.
[[nodiscard]] std::string forMessage(std::string_view text, std::size_t max_bytes = 1024);
/// The same for one word of a file.
[[nodiscard]] inline std::string wordForMessage(std::string_view word) { return forMessage(word, 64); }

inline constexpr std::string_view kLfsPointer = "version https://git-lfs";
/// @throws InputError "input.lfs_pointer"
void refuseLfsPointer(std::string_view beginning, const std::string& subject);

/// An input file that is open for reading.
class InputDescriptor {
 public:
  /// @throws InputError (missing, no permission)
  explicit InputDescriptor(const std::filesystem::path& path);
  ~InputDescriptor();
  InputDescriptor(const InputDescriptor&) = delete;
  InputDescriptor& operator=(const InputDescriptor&) = delete;

  /// Bytes at present. @throws InputError (folder, pipe, device)
  [[nodiscard]] std::uint64_t size() const;
  /// @return bytes copied; fewer than `count` only at the end of the file. @throws InputError
  [[nodiscard]] std::size_t readAt(std::uint64_t offset, char* to, std::size_t count) const;
  /// @throws InputError "input.changed"
  [[noreturn]] void throwChanged() const;

 private:
  std::filesystem::path path_;
  int fd_;
};

/// Size of a regular file in bytes. @throws InputError (missing, folder, pipe, device, no permission)
[[nodiscard]] std::uint64_t inputFileSize(const std::filesystem::path& path);

/// Content of the file, at most max_bytes from its beginning.
/// @throws InputError (as inputFileSize; empty, Git LFS pointer, changed while being read)
[[nodiscard]] std::string readInputFile(const std::filesystem::path& path, std::uint64_t max_bytes = UINT64_MAX);

/// How many of the announced records the available bytes contain. Never multiplies numbers from the file.
/// @param record_bytes  > 0
/// @param[out] missing  announced records missing in the file
/// @throws InputError "input.truncated" naming both byte counts, unless allow_truncated
[[nodiscard]] std::uint64_t recordsAvailable(const std::string& subject, std::uint64_t promised,
                                             std::uint64_t record_bytes, std::uint64_t available_bytes,
                                             bool allow_truncated, std::uint64_t& missing);

}  // namespace accessvdb::io
