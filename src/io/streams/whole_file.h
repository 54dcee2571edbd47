// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files that are whole or not there, and on the disk for good only when they are brought there: for those that count
/// together from a later moment on, and that nobody shall wait for before.
#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>

namespace accessvdb::io {

/// writeFileDurably() or writeFileWhole().
using WriteFile = void (*)(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body);

/// As writeFileDurably(), but a power cut may take the file away or leave it damaged, until bringToDisk(). The system
/// begins to write it to the disk. @throws OutputError
void writeFileWhole(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body);
/// @param file  that writeFileWhole() wrote; its name is only there for good when its folder is, too
/// @throws OutputError
void bringToDisk(const std::filesystem::path& file);

}  // namespace accessvdb::io
