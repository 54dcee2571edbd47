// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bags/chunk_bytes.h"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <limits>
#include <memory>

namespace accessvdb::bags {
namespace {

/// Where the format does not say how much comes out, room is made for this many times what goes in, or 1 MiB, and more
/// as it comes: what a few bytes declare must not become an allocation.
constexpr std::uint64_t kUsualRatio = 64;
constexpr std::uint64_t kLeastRoom = std::uint64_t{1} << 20;
/// Limits the memory for a stream without a declared size to 32 MiB. Recorders stay below 8 MiB.
constexpr int kZstdWindowLog = 25;

std::string otherSize(std::uint64_t declared) { return "declares " + std::to_string(declared) + " bytes and has "; }
std::string tooMany(std::uint64_t declared) { return otherSize(declared) + "more"; }
std::string tooFew(std::uint64_t declared, std::uint64_t have) { return otherSize(declared) + std::to_string(have); }
const std::string kDamaged = "cannot be unpacked: it is damaged";

/// Calls step(from, from_bytes, to, to_bytes) until the input is used up; it takes away what it used from both pairs.
/// @return what is wrong
template <typename Step>
std::string unpackStream(std::string_view packed, std::uint64_t declared, ByteBuffer& out, const Step& step) {
  std::size_t have = 0;
  auto room = static_cast<std::size_t>(std::min(declared, std::max(kLeastRoom, kUsualRatio * packed.size())));
  out.reset(room);
  for (bool more = true; more;) {
    if (have == room && room < declared) {
      room = static_cast<std::size_t>(std::min(declared, 2 * std::uint64_t{room}));
      out.grow(room);
    }
    char beyond = 0;  // one byte more than declared shows that there is more
    const bool full = have == room;
    char* const to = full ? &beyond : out.data() + have;
    std::size_t to_bytes = full ? 1 : room - have;
    const std::size_t offered = to_bytes, before = packed.size();
    if (!step(packed, to, to_bytes, more)) return kDamaged;
    const std::size_t written = offered - to_bytes;
    if (full && written > 0) return tooMany(declared);
    have += written;
    if (more && written == 0 && packed.size() == before) return packed.empty() ? tooFew(declared, have) : kDamaged;
  }
  out.shrink(have);
  return have == declared ? std::string() : tooFew(declared, have);
}

std::string unpackZstd(std::string_view packed, std::uint64_t declared, ByteBuffer& out) {
  const unsigned long long known = ZSTD_getFrameContentSize(packed.data(), packed.size());
  if (known == ZSTD_CONTENTSIZE_ERROR) return kDamaged;
  if (known != ZSTD_CONTENTSIZE_UNKNOWN &&
      ZSTD_findFrameCompressedSize(packed.data(), packed.size()) == packed.size()) {
    if (known != declared) return tooFew(declared, known);
    const std::size_t have = ZSTD_decompress(out.reset(declared), declared, packed.data(), packed.size());
    if (ZSTD_isError(have) != 0) return kDamaged;
    return have == declared ? std::string() : tooFew(declared, have);
  }
  const std::unique_ptr<ZSTD_DStream, decltype(&ZSTD_freeDStream)> stream(ZSTD_createDStream(), &ZSTD_freeDStream);
  if (!stream || ZSTD_isError(ZSTD_DCtx_setParameter(stream.get(), ZSTD_d_windowLogMax, kZstdWindowLog)) != 0)
    return kDamaged;
  return unpackStream(packed, declared, out, [&](std::string_view& from, char* to, std::size_t& to_bytes, bool& more) {
    ZSTD_inBuffer input = {from.data(), from.size(), 0};
    ZSTD_outBuffer output = {to, to_bytes, 0};
    const std::size_t left = ZSTD_decompressStream(stream.get(), &output, &input);
    if (ZSTD_isError(left) != 0) return false;
    from.remove_prefix(input.pos);
    to_bytes -= output.pos;
    more = left != 0 || !from.empty();
    return true;
  });
}

std::string unpackLz4(std::string_view packed, std::uint64_t declared, ByteBuffer& out) {
  LZ4F_dctx* raw = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&raw, LZ4F_VERSION)) != 0) return kDamaged;
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(raw,
                                                                                     &LZ4F_freeDecompressionContext);
  return unpackStream(packed, declared, out, [&](std::string_view& from, char* to, std::size_t& to_bytes, bool& more) {
    std::size_t used = from.size(), written = to_bytes;
    const std::size_t left = LZ4F_decompress(context.get(), to, &written, from.data(), &used, nullptr);
    if (LZ4F_isError(left) != 0) return false;
    from.remove_prefix(used);
    to_bytes -= written;
    more = left != 0 || !from.empty();
    return true;
  });
}

std::string unpackBz2(std::string_view packed, std::uint64_t declared, ByteBuffer& out) {
  bz_stream stream = {};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) return kDamaged;
  const std::unique_ptr<bz_stream, decltype(&BZ2_bzDecompressEnd)> end(&stream, &BZ2_bzDecompressEnd);
  return unpackStream(packed, declared, out, [&](std::string_view& from, char* to, std::size_t& to_bytes, bool& more) {
    constexpr std::size_t kMost = std::numeric_limits<unsigned>::max();
    const auto offered = static_cast<unsigned>(std::min(from.size(), kMost));
    // The interface of bzip2 predates const.
    stream.next_in = const_cast<char*>(from.data());
    stream.avail_in = offered;
    stream.next_out = to;
    stream.avail_out = static_cast<unsigned>(std::min(to_bytes, kMost));
    const unsigned room = stream.avail_out;
    const int status = BZ2_bzDecompress(&stream);
    if (status != BZ_OK && status != BZ_STREAM_END) return false;
    from.remove_prefix(offered - stream.avail_in);
    to_bytes -= room - stream.avail_out;
    more = status != BZ_STREAM_END;
    return true;
  });
}

}  // namespace

std::optional<ChunkCompression> compressionFrom(std::string_view word) {
  if (word.empty() || word == "none") return ChunkCompression::None;
  if (word == "zstd") return ChunkCompression::Zstd;
  if (word == "lz4") return ChunkCompression::Lz4;
  if (word == "bz2") return ChunkCompression::Bz2;
  return std::nullopt;
}

std::string unpack(ChunkCompression compression, std::string_view packed, std::uint64_t declared, ByteBuffer& out) {
  switch (compression) {
    case ChunkCompression::None:
      if (packed.size() != declared) return tooFew(declared, packed.size());
      std::copy(packed.begin(), packed.end(), out.reset(packed.size()));
      return {};
    case ChunkCompression::Zstd:
      return unpackZstd(packed, declared, out);
    case ChunkCompression::Lz4:
      return unpackLz4(packed, declared, out);
    case ChunkCompression::Bz2:
      return unpackBz2(packed, declared, out);
  }
  return kDamaged;
}

}  // namespace accessvdb::bags
