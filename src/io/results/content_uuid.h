// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A file's unique identifier made from its content, so that equal runs write equal files.
#pragma once

#include <cstdint>
#include <ostream>
#include <streambuf>
#include <string>

#include "io/streams/sha256.h"

namespace accessvdb::internal {

/// "xxxxxxxx-xxxx-8xxx-xxxx-xxxxxxxxxxxx": RFC 9562, version 8, from the first bytes of a digest.
[[nodiscard]] std::string uuidOf(const Sha256::Digest& digest);

/// Whether text has the form of a UUID.
[[nodiscard]] bool isUuid(const std::string& text);

/// Passes everything on to another buffer, and digests what is written and where. The same writes in the same order
/// give the same digest; so do writes that are cut differently into pieces.
class DigestBuffer : public std::streambuf {
 public:
  explicit DigestBuffer(std::streambuf& to) : to_(to) {}

  [[nodiscard]] Sha256::Digest digest() { return sha256_.digest(); }

 protected:
  int_type overflow(int_type c) override;
  std::streamsize xsputn(const char* data, std::streamsize size) override;
  int sync() override { return to_.pubsync(); }
  pos_type seekoff(off_type offset, std::ios_base::seekdir from, std::ios_base::openmode which) override;
  pos_type seekpos(pos_type position, std::ios_base::openmode which) override;

 private:
  pos_type moved(pos_type to);

  std::streambuf& to_;
  Sha256 sha256_;
};

}  // namespace accessvdb::internal
