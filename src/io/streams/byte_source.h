// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The bytes of an input through a window of bounded size, for inputs that are larger than memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace accessvdb::io {

/// Bytes that are looked at in any order, cheapest in ascending order.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  ByteSource() = default;
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;

  /// Bytes from `offset` on: at least `count`, fewer only at the end of the input, often more. Valid until the next
  /// call. @throws InputError (unreadable, changed while being read, a decoder that failed)
  [[nodiscard]] std::string_view view(std::uint64_t offset, std::size_t count) {
    const std::uint64_t skip = offset - begin_;  // wraps for bytes before the window
    if (skip > have_ || (have_ - skip < count && !ends_)) {
      slide(offset, count);
      return {window_.data(), have_};
    }
    return {window_.data() + skip, have_ - static_cast<std::size_t>(skip)};
  }

  /// Bytes of the whole input; of a pipe only once its end has been seen.
  [[nodiscard]] virtual std::optional<std::uint64_t> size() const = 0;
  /// Checks, after the last byte has been used, that the input was what it seemed to be. @throws InputError
  virtual void checkAtEnd() = 0;

 protected:
  /// Copies bytes from `offset` on; fewer than `wanted` only at the end of the input. @return bytes copied
  [[nodiscard]] virtual std::size_t fill(std::uint64_t offset, char* to, std::size_t wanted) = 0;

 private:
  void slide(std::uint64_t offset, std::size_t count);

  std::vector<char> window_;
  std::uint64_t begin_ = 0;
  std::size_t have_ = 0;
  bool ends_ = false;  ///< the window reaches the end of the input
};

/// A regular file, read with pread, not mapped: a file that shrinks must not raise a signal.
/// @throws InputError as readInputFile
[[nodiscard]] std::unique_ptr<ByteSource> openFile(const std::filesystem::path& path);

}  // namespace accessvdb::io
