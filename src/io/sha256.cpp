// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <openssl/evp.h>

#include <array>
#include <fstream>
#include <memory>

#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "io/input_file.h"

namespace accessvdb::io {

std::string sha256OfFile(const std::filesystem::path& path) {
  (void)inputFileSize(path);
  std::ifstream file(path, std::ios::binary);
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(), &EVP_MD_CTX_free);
  if (!context || EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) != 1)
    throw InternalError("internal.sha256", "OpenSSL", "does not provide SHA-256");
  std::vector<char> block(std::size_t{1} << 20);
  while (file) {
    file.read(block.data(), static_cast<std::streamsize>(block.size()));
    EVP_DigestUpdate(context.get(), block.data(), static_cast<std::size_t>(file.gcount()));
  }
  if (!file.eof() || file.bad())
    throw InputError("input.unreadable", forMessage(path.native()), "reading failed", "Check the disk and permissions");
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest;
  unsigned length = 0;
  EVP_DigestFinal_ex(context.get(), digest.data(), &length);
  constexpr const char* kHex = "0123456789abcdef";
  std::string text;
  for (unsigned i = 0; i < length; ++i) {
    text += kHex[digest[i] >> 4];
    text += kHex[digest[i] & 15];
  }
  return text;
}

}  // namespace accessvdb::io
