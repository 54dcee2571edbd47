// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files made by hand, byte by byte.
#pragma once

#include <cstring>
#include <string>

namespace accessvdb::test {

/// Appends the bytes of a number as stored on this (little-endian) machine.
template <typename T>
void put(std::string& bytes, T value) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes.append(raw, sizeof(T));
}

}  // namespace accessvdb::test
