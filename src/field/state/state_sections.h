// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The container of a saved state: a magic line, then sections, one after the other and in a fixed order.
///
///   name [8], length of the content u64, content, SHA-256 [32] of all of these and of the hash before it
///
/// Each hash also covers the one before it, so sections of different files cannot be put together. Numbers are little
/// endian. Both sides stream: they hold one block, whatever the length.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iosfwd>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "io/streams/sha256.h"

namespace accessvdb::internal {

inline constexpr std::string_view kStateMagic = "AccessVDB state\n";
/// Name, length and hash of a section.
inline constexpr std::uint64_t kSectionFrameBytes = 8 + 8 + 32;

class SectionWriter {
 public:
  /// @param out  throws on failure; must outlive this
  explicit SectionWriter(std::ostream& out);
  /// @param name  at most 8 characters  @param bytes  exactly as many must follow
  void begin(std::string_view name, std::uint64_t bytes);
  void write(const void* data, std::size_t bytes);
  /// @throws InternalError  fewer or more bytes than announced
  void end();

 private:
  void flush();

  std::ostream& out_;
  std::unique_ptr<Sha256> sha256_;
  Sha256::Digest before_ = {};
  std::vector<char> block_;
  std::uint64_t left_ = 0;
};

class SectionReader {
 public:
  /// @throws InputError  not readable, or not a state
  explicit SectionReader(std::filesystem::path file);

  [[nodiscard]] std::uint64_t fileBytes() const { return file_bytes_; }
  /// @return length of the content, checked against the size of the file  @throws InputError "state.damaged"
  std::uint64_t begin(std::string_view name);
  /// @throws InputError "state.damaged"  the section or the file is too short
  void read(void* to, std::size_t bytes);
  /// @return the hash  @throws InputError "state.damaged"  content is left, or the hash is another
  Sha256::Digest end();

  /// @throws InputError "state.damaged", naming the section
  [[noreturn]] void refuse(const std::string& what) const;

 private:
  void readRaw(void* to, std::size_t bytes);
  void refill();

  std::filesystem::path file_;
  std::ifstream in_;
  std::uint64_t file_bytes_ = 0, file_left_ = 0;
  std::string section_;
  std::unique_ptr<Sha256> sha256_;
  Sha256::Digest before_ = {};
  std::vector<char> block_;
  std::size_t at_ = 0, end_ = 0;  ///< what of the block was not read yet
  std::uint64_t left_ = 0;        ///< content after the block
};

}  // namespace accessvdb::internal
