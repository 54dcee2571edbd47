// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files that a command decodes: it writes what it decoded to its standard output, which is read through a pipe.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "io/streams/byte_source.h"

namespace accessvdb::io {

/// The first of the usual decoders of LAZ that is in PATH, as a command; empty if there is none.
[[nodiscard]] std::string findLazDecoder();

/// What the command writes for a file. The command is split at blanks, gets the file's name as its last argument, and
/// runs without a shell. Going back to earlier bytes starts it again.
/// @throws InputError "input.decoder" (cannot be started, failed, hangs), also from the source
[[nodiscard]] std::unique_ptr<ByteSource> openDecoder(const std::filesystem::path& path, const std::string& command);

/// Whether a program is in PATH.
[[nodiscard]] bool isInstalled(const std::string& program);
/// The same for an argument that is no file.
[[nodiscard]] std::unique_ptr<ByteSource> openProgram(const std::string& argument, const std::string& command);

}  // namespace accessvdb::io
