// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/results/content_uuid.h"

#include <cstddef>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kUuidLength = 36;
bool isDash(std::size_t at) { return at == 8 || at == 13 || at == 18 || at == 23; }

}  // namespace

std::string uuidOf(const Sha256::Digest& digest) {
  Sha256::Digest bytes = digest;
  bytes[6] = static_cast<unsigned char>((bytes[6] & 0x0f) | 0x80);  // version 8: made as the software likes
  bytes[8] = static_cast<unsigned char>((bytes[8] & 0x3f) | 0x80);  // the variant of RFC 9562
  constexpr const char* kHex = "0123456789abcdef";
  std::string text;
  for (std::size_t n = 0; n < 16; ++n) {
    if (isDash(text.size())) text += '-';
    text += kHex[bytes[n] >> 4];
    text += kHex[bytes[n] & 15];
  }
  return text;
}

bool isUuid(const std::string& text) {
  if (text.size() != kUuidLength) return false;
  for (std::size_t at = 0; at < text.size(); ++at) {
    const bool hex = std::string("0123456789abcdefABCDEF").find(text[at]) != std::string::npos;
    if (isDash(at) ? text[at] != '-' : !hex) return false;
  }
  return true;
}

DigestBuffer::int_type DigestBuffer::overflow(int_type c) {
  if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
  const char one = traits_type::to_char_type(c);
  return xsputn(&one, 1) == 1 ? c : traits_type::eof();
}

std::streamsize DigestBuffer::xsputn(const char* data, std::streamsize size) {
  sha256_.update(data, static_cast<std::size_t>(size));
  return to_.sputn(data, size);
}

DigestBuffer::pos_type DigestBuffer::seekoff(off_type offset, std::ios_base::seekdir from,
                                             std::ios_base::openmode which) {
  const pos_type to = to_.pubseekoff(offset, from, which);
  return from == std::ios_base::cur && offset == 0 ? to : moved(to);  // a question where we are is no move
}
DigestBuffer::pos_type DigestBuffer::seekpos(pos_type position, std::ios_base::openmode which) {
  return moved(to_.pubseekpos(position, which));
}

DigestBuffer::pos_type DigestBuffer::moved(pos_type to) {
  const auto at = static_cast<std::int64_t>(off_type(to));
  sha256_.update(&at, sizeof(at));
  return to;
}

}  // namespace accessvdb::internal
