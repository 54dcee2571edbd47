// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// SHA-256 of bytes that come piece by piece.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>

namespace accessvdb::internal {

class Sha256 {
 public:
  using Digest = std::array<unsigned char, 32>;

  /// @throw InternalError  OpenSSL does not provide it
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void update(const void* data, std::size_t bytes);
  /// Ends it; call it once.
  [[nodiscard]] Digest digest();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

/// Lower-case hexadecimal.
[[nodiscard]] std::string hexOf(const Sha256::Digest& digest);

}  // namespace accessvdb::internal
