// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The boundary between C and C++: exceptions become codes, structs are read and written by their stated size, pointers
/// are checked before anything happens.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

#include "accessvdb/c_api.h"
#include "accessvdb/error.h"

namespace accessvdb::capi {

/// Larger than any struct or point of a later version; anything beyond is an uninitialised struct_size.
inline constexpr std::size_t kMostStructBytes = 4096;

/// Describes the exception being handled and returns its code. Allocates nothing.
int describeCurrentException(accessvdb_error& error) noexcept;

/// Runs `body` and returns 0, or the code of what it threw.
template <typename Body>
int guarded(accessvdb_error& error, const Body& body) noexcept {
  try {
    body();
    return ACCESSVDB_OK;
  } catch (...) {
    return describeCurrentException(error);
  }
}

/// Like guarded(), for calls without a handle: the error goes to the caller's struct, if it is valid.
template <typename Body>
int guardedWithout(accessvdb_error* given, const Body& body) noexcept;

/// @throws InvalidArgument "c_api.null"
void requirePointer(const char* name, const void* pointer);
/// @throws InvalidArgument "c_api.null", "c_api.value" for an empty one. @param advice  what to do next
void requireText(const char* name, const char* text, const char* advice);
/// An array of `count` elements: not NULL unless empty, aligned, and not larger than the address space.
/// @throws InvalidArgument "c_api.null", "c_api.alignment", "c_api.count"
void requireArray(const char* name, const void* pointer, std::size_t count, std::size_t element_bytes,
                  std::size_t alignment);
/// @throws InvalidArgument "c_api.struct_size" unless least <= size <= kMostStructBytes
void requireSize(const char* name, std::size_t size, std::size_t least);
/// @throws InvalidArgument "c_api.value" unless low <= value <= high
std::int32_t requireChoice(const char* name, std::int32_t value, std::int32_t low, std::int32_t high);
inline bool requireBool(const char* name, std::int32_t value) { return requireChoice(name, value, 0, 1) != 0; }

/// @throws InvalidArgument "c_api.unknown_fields" if bytes unknown to this version are set
void requireZero(const char* name, const unsigned char* begin, const unsigned char* end);

/// The given struct_size after its checks. @param least  size of the struct's first version
template <typename Struct>
std::size_t checkedSize(const char* name, const Struct* given, std::size_t least) {
  requirePointer(name, given);
  std::uint32_t size = 0;
  std::memcpy(&size, given, sizeof size);
  requireSize(name, size, least);
  return size;
}

/// `defaults` overwritten with the fields of the caller's version of the struct.
template <typename Struct>
Struct readSized(const char* name, const Struct* given, std::size_t least, Struct defaults) {
  const std::size_t size = checkedSize(name, given, least);
  const auto* bytes = reinterpret_cast<const unsigned char*>(given);
  if (size > sizeof(Struct)) requireZero(name, bytes + sizeof(Struct), bytes + size);
  std::memcpy(&defaults, given, size < sizeof(Struct) ? size : sizeof(Struct));
  return defaults;
}

/// Writes as much of `value` as the caller has room for, zeros beyond what this version knows.
template <typename Row>
void writeRow(void* out, std::size_t size, const Row& value) {
  std::memcpy(out, &value, size < sizeof(Row) ? size : sizeof(Row));
  if (size > sizeof(Row)) std::memset(static_cast<unsigned char*>(out) + sizeof(Row), 0, size - sizeof(Row));
}

/// The same for a struct with a size field, which it keeps.
template <typename Struct>
void writeSized(Struct* out, std::size_t size, Struct value) {
  value.struct_size = static_cast<std::uint32_t>(size);
  writeRow(out, size, value);
}

/// A struct of the caller's that a call fills in, or null. @tparam kBytes1  size of its first version
template <typename Struct, std::size_t kBytes1>
class OptionalOut {
 public:
  /// Checks it before anything happens. @throws InvalidArgument "c_api.struct_size"
  OptionalOut(const char* name, Struct* out) : out_(out), size_(out == nullptr ? 0 : checkedSize(name, out, kBytes1)) {}
  void write(const Struct& value) const {
    if (out_ != nullptr) writeSized(out_, size_, value);
  }

 private:
  static_assert(sizeof(Struct) >= kBytes1);
  Struct* out_;
  std::size_t size_;
};

template <typename Body>
int guardedWithout(accessvdb_error* given, const Body& body) noexcept {
  accessvdb_error error = {};
  int code = ACCESSVDB_OK;
  std::size_t room = 0;
  if (given != nullptr) code = guarded(error, [&] { room = checkedSize("error", given, sizeof(accessvdb_error)); });
  if (code == ACCESSVDB_OK) code = guarded(error, body);
  if (room > 0) writeSized(given, room, error);
  return code;
}

}  // namespace accessvdb::capi
