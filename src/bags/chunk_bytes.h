// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Unpacks the chunks of recordings. What a chunk declares is not believed: it bounds what may be unpacked, and has to
/// be what comes out.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "bags/byte_buffer.h"

namespace accessvdb::bags {

/// No recorder writes larger chunks or messages: the usual size is 1 to 4 MiB.
inline constexpr std::uint64_t kMostChunkBytes = std::uint64_t{1} << 30;

enum class ChunkCompression { None, Zstd, Lz4, Bz2 };

/// "", "none", "zstd", "lz4", "bz2"; nothing for other words.
[[nodiscard]] std::optional<ChunkCompression> compressionFrom(std::string_view word);

/// @param declared  bytes that the chunk says it has; at most kMostChunkBytes
/// @return what is wrong with the chunk, in words; empty if `out` holds exactly that many bytes
[[nodiscard]] std::string unpack(ChunkCompression compression, std::string_view packed, std::uint64_t declared,
                                 ByteBuffer& out);

}  // namespace accessvdb::bags
