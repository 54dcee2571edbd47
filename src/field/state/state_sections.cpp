// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/state/state_sections.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <ostream>
#include <utility>

#include "accessvdb/error.h"
#include "io/streams/input_file.h"

namespace accessvdb::internal {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they are in memory");

constexpr std::size_t kBlockBytes = std::size_t{1} << 20;

using SectionName = std::array<char, 8>;

SectionName padded(std::string_view name) {
  SectionName bytes = {};
  std::copy_n(name.data(), std::min(name.size(), bytes.size()), bytes.data());
  return bytes;
}

/// Starts the hash of a section.
std::unique_ptr<Sha256> hashAfter(const Sha256::Digest& before, const SectionName& name, std::uint64_t bytes) {
  auto sha256 = std::make_unique<Sha256>();
  sha256->update(before.data(), before.size());
  sha256->update(name.data(), name.size());
  sha256->update(&bytes, sizeof bytes);
  return sha256;
}

}  // namespace

SectionWriter::SectionWriter(std::ostream& out) : out_(out) {
  block_.reserve(kBlockBytes);
  out_.write(kStateMagic.data(), static_cast<std::streamsize>(kStateMagic.size()));
}

void SectionWriter::begin(std::string_view name, std::uint64_t bytes) {
  const SectionName padded_name = padded(name);
  sha256_ = hashAfter(before_, padded_name, bytes);
  left_ = bytes;
  out_.write(padded_name.data(), padded_name.size());
  out_.write(reinterpret_cast<const char*>(&bytes), sizeof bytes);
}

void SectionWriter::write(const void* data, std::size_t bytes) {
  if (bytes > left_) throw InternalError("state.length", "", "a section of a state became longer than announced");
  left_ -= bytes;
  const char* from = static_cast<const char*>(data);
  while (bytes > 0) {
    const std::size_t part = std::min(bytes, kBlockBytes - block_.size());
    block_.insert(block_.end(), from, from + part);
    if (block_.size() == kBlockBytes) flush();
    from += part;
    bytes -= part;
  }
}

void SectionWriter::flush() {
  sha256_->update(block_.data(), block_.size());
  out_.write(block_.data(), static_cast<std::streamsize>(block_.size()));
  block_.clear();
}

void SectionWriter::end() {
  if (left_ != 0) throw InternalError("state.length", "", "a section of a state became shorter than announced");
  flush();
  before_ = sha256_->digest();
  out_.write(reinterpret_cast<const char*>(before_.data()), static_cast<std::streamsize>(before_.size()));
}

SectionReader::SectionReader(std::filesystem::path file)
    : file_(std::move(file)), file_bytes_(io::inputFileSize(file_)), file_left_(file_bytes_) {
  in_.open(file_, std::ios::binary);
  std::array<char, kStateMagic.size()> magic = {};
  if (file_left_ >= magic.size()) readRaw(magic.data(), magic.size());
  if (std::string_view(magic.data(), magic.size()) != kStateMagic) {
    throw InputError("state.format", io::forMessage(file_.native()), "is not a saved state of AccessVDB",
                     "Name a file that saveState() wrote");
  }
}

void SectionReader::refuse(const std::string& what) const {
  throw InputError("state.damaged", io::forMessage(file_.native()),
                   (section_.empty() ? "the state" : "section \"" + section_ + "\"") + " is damaged: " + what,
                   "Use another checkpoint, or start without one");
}

void SectionReader::readRaw(void* to, std::size_t bytes) {
  if (bytes > file_left_) refuse("the file ends too early");
  in_.read(static_cast<char*>(to), static_cast<std::streamsize>(bytes));
  if (!in_ || static_cast<std::size_t>(in_.gcount()) != bytes) {
    throw InputError("input.unreadable", io::forMessage(file_.native()), "cannot be read to its end",
                     "Check its permissions and the disk");
  }
  file_left_ -= bytes;
}

std::uint64_t SectionReader::begin(std::string_view name) {
  section_ = name;
  SectionName found = {};
  std::uint64_t bytes = 0;
  readRaw(found.data(), found.size());
  readRaw(&bytes, sizeof bytes);
  if (found != padded(name)) refuse("another section is in its place");
  if (bytes > file_left_ || file_left_ - bytes < before_.size()) refuse("it is longer than the file");
  sha256_ = hashAfter(before_, found, bytes);
  at_ = end_ = 0;
  left_ = bytes;
  return bytes;
}

void SectionReader::refill() {
  const std::size_t bytes = static_cast<std::size_t>(std::min<std::uint64_t>(left_, kBlockBytes));
  if (bytes == 0) refuse("it ends too early");
  if (block_.empty()) block_.resize(kBlockBytes);
  readRaw(block_.data(), bytes);
  sha256_->update(block_.data(), bytes);
  left_ -= bytes;
  at_ = 0;
  end_ = bytes;
}

void SectionReader::read(void* to, std::size_t bytes) {
  char* out = static_cast<char*>(to);
  while (bytes > 0) {
    if (at_ == end_) refill();
    const std::size_t part = std::min(bytes, end_ - at_);
    std::memcpy(out, block_.data() + at_, part);
    at_ += part;
    out += part;
    bytes -= part;
  }
}

Sha256::Digest SectionReader::end() {
  if (at_ != end_ || left_ != 0) refuse("it has more content than expected");
  Sha256::Digest stored = {};
  readRaw(stored.data(), stored.size());
  before_ = sha256_->digest();
  if (stored != before_) refuse("its content does not match its hash");
  return before_;
}

}  // namespace accessvdb::internal
