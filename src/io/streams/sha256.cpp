// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/streams/sha256.h"

#include <openssl/evp.h>

#include <fstream>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "io/streams/input_file.h"

namespace accessvdb::internal {

struct Sha256::Context {
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> evp = {EVP_MD_CTX_new(), &EVP_MD_CTX_free};
};

Sha256::Sha256() : context_(std::make_unique<Context>()) {
  if (!context_->evp || EVP_DigestInit_ex(context_->evp.get(), EVP_sha256(), nullptr) != 1)
    throw InternalError("internal.sha256", "OpenSSL", "does not provide SHA-256");
}
Sha256::~Sha256() = default;
Sha256::Sha256(Sha256&&) noexcept = default;
Sha256& Sha256::operator=(Sha256&&) noexcept = default;

void Sha256::update(const void* data, std::size_t bytes) { EVP_DigestUpdate(context_->evp.get(), data, bytes); }

Sha256::Digest Sha256::digest() {
  Digest digest = {};
  EVP_DigestFinal_ex(context_->evp.get(), digest.data(), nullptr);
  return digest;
}

std::string hexOf(const Sha256::Digest& digest) {
  constexpr const char* kHex = "0123456789abcdef";
  std::string text;
  for (const unsigned char byte : digest) {
    text += kHex[byte >> 4];
    text += kHex[byte & 15];
  }
  return text;
}

}  // namespace accessvdb::internal

namespace accessvdb::io {

std::string sha256OfFile(const std::filesystem::path& path) {
  (void)inputFileSize(path);
  std::ifstream file(path, std::ios::binary);
  internal::Sha256 sha256;
  std::vector<char> block(std::size_t{1} << 20);
  while (file) {
    file.read(block.data(), static_cast<std::streamsize>(block.size()));
    sha256.update(block.data(), static_cast<std::size_t>(file.gcount()));
  }
  if (!file.eof() || file.bad())
    throw InputError("input.unreadable", forMessage(path.native()), "reading failed", "Check the disk and permissions");
  return internal::hexOf(sha256.digest());
}

}  // namespace accessvdb::io
