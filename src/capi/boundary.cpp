// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "capi/boundary.h"

#include <algorithm>
#include <new>

namespace accessvdb::capi {
namespace {

/// Copies as much text as fits, zero-terminated, never splitting a UTF-8 character.
template <std::size_t kRoom>
void copyText(char (&to)[kRoom], const char* from) noexcept {
  std::size_t length = std::strlen(from);
  if (length >= kRoom) {
    length = kRoom - 1;
    while (length > 0 && (static_cast<unsigned char>(from[length]) & 0xC0u) == 0x80u) --length;
  }
  std::memcpy(to, from, length);
  std::fill(to + length, to + kRoom, '\0');
}

int describe(accessvdb_error& error, int code, const char* id, const char* text) noexcept {
  error.code = code;
  copyText(error.id, id);
  copyText(error.text, text);
  return code;
}

}  // namespace

int describeCurrentException(accessvdb_error& error) noexcept {
  try {
    throw;
  } catch (const Error& e) {
    return describe(error, e.exitCode(), e.id().c_str(), e.what());
  } catch (const std::bad_alloc&) {
    return describe(error, ACCESSVDB_ERROR_RESOURCE, "memory.exhausted",
                    "not enough memory. Choose a larger voxel size, or free some memory.");
  } catch (const std::exception& e) {
    return describe(error, ACCESSVDB_ERROR_INTERNAL, "internal", e.what());
  } catch (...) {
    return describe(error, ACCESSVDB_ERROR_INTERNAL, "internal", "an exception of unknown kind");
  }
}

void requirePointer(const char* name, const void* pointer) {
  if (pointer == nullptr) throw InvalidArgument("c_api.null", name, "is NULL");
}

void requireText(const char* name, const char* text, const char* advice) {
  requirePointer(name, text);
  if (*text == '\0') throw InvalidArgument("c_api.value", name, "is empty", advice);
}

void requireArray(const char* name, const void* pointer, std::size_t count, std::size_t element_bytes,
                  std::size_t alignment) {
  if (count == 0) return;
  requirePointer(name, pointer);
  if (reinterpret_cast<std::uintptr_t>(pointer) % alignment != 0) {
    throw InvalidArgument("c_api.alignment", name, "is not aligned to " + std::to_string(alignment) + " bytes",
                          "Pass an array of the type that the function names");
  }
  if (count > PTRDIFF_MAX / element_bytes) {
    throw InvalidArgument("c_api.count", name, std::to_string(count) + " elements do not fit into memory",
                          "Check the count; a negative number becomes a huge one");
  }
}

void requireSize(const char* name, std::size_t size, std::size_t least) {
  if (size >= least && size <= kMostStructBytes) return;
  throw InvalidArgument("c_api.struct_size", name,
                        "its size is given as " + std::to_string(size) + " bytes, which is outside " +
                            std::to_string(least) + " .. " + std::to_string(kMostStructBytes),
                        "Pass sizeof(the struct)");
}

std::int32_t requireChoice(const char* name, std::int32_t value, std::int32_t low, std::int32_t high) {
  if (value >= low && value <= high) return value;
  throw InvalidArgument(
      "c_api.value", name,
      std::to_string(value) + " is not one of " + std::to_string(low) + " .. " + std::to_string(high));
}

void requireZero(const char* name, const unsigned char* begin, const unsigned char* end) {
  if (std::all_of(begin, end, [](unsigned char byte) { return byte == 0; })) return;
  throw InvalidArgument("c_api.unknown_fields", name, "it sets fields that this version of the library does not know",
                        "Load the library that matches your header, or leave the new fields zero");
}

}  // namespace accessvdb::capi
