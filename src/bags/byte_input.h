// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the bytes of a recording come from.
#pragma once

#include <cstddef>
#include <cstdint>

namespace accessvdb::bags {

class ByteInput {
 public:
  virtual ~ByteInput() = default;
  ByteInput() = default;
  ByteInput(const ByteInput&) = delete;
  ByteInput& operator=(const ByteInput&) = delete;

  [[nodiscard]] virtual std::uint64_t size() const = 0;
  /// Copies exactly `count` bytes; offset + count must not exceed size(). @throws InputError
  virtual void read(std::uint64_t offset, char* to, std::size_t count) const = 0;
};

}  // namespace accessvdb::bags
