// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// MCAP (ROS 2's default, version 0 of the format): https://mcap.dev/spec
///
/// magic, then records of opcode (1 byte), length (8), content. The index at the end is not used.

#include <algorithm>
#include <array>
#include <limits>

#include "accessvdb/error.h"
#include "bags/byte_buffer.h"
#include "bags/chunk_bytes.h"
#include "bags/mcap_format.h"
#include "bags/record_reader.h"
#include "bags/recording.h"

namespace accessvdb::bags {
namespace {

constexpr std::size_t kRecordHead = 9;
/// Length of a chunk's content before the name of its compression: start, end, size, checksum.
constexpr std::size_t kChunkHead = 28;
constexpr std::size_t kMostWord = 64;
/// Schemas may be long texts; nothing else that is read outside of chunks is, except messages.
constexpr std::uint64_t kMostRecordBytes = std::uint64_t{16} << 20;

struct Head {
  unsigned char opcode = 0;
  std::uint64_t bytes = 0;
};

struct Damage {
  std::string id, problem;
};

class McapReader final : public Recording {
 public:
  McapReader(std::unique_ptr<ByteInput> input, const OpenRecording& open)
      : input_(std::move(input)), open_(open), end_(input_->size()), channel_(65536, kUnknown), type_(65536) {
    std::array<char, mcap::kMagic.size()> magic = {};
    if (end_ >= magic.size()) input_->read(0, magic.data(), magic.size());
    if (std::string_view(magic.data(), magic.size()) != mcap::kMagic)
      throw InputError("recording.format", open_.subject, "is not an MCAP file: it does not begin with MCAP's mark",
                       "Check the file's name, or copy it again");
  }

  void scan(const Wanted& wanted, const Use& use) override {
    std::uint64_t at = mcap::kMagic.size();
    try {
      while (scanRecord(at, wanted, use)) {
      }
    } catch (const Damage& damage) {
      if (!open_.allow_truncated) refuse(at, damage);
      cut_off_ = "is damaged at byte " + std::to_string(at) + " of " + std::to_string(end_);
    }
  }

  [[nodiscard]] std::string_view read(const Place& place) override {
    try {
      if (place.block != loaded_) {
        const Head head = headAt(place.block);
        if (head.opcode == mcap::kChunk) {
          loadChunk(place.block, head, false);
        } else {
          loadMessage(place.block, head);
        }
      }
      RecordReader reader(unpacked_.view());
      (void)reader.take(place.offset);
      const std::string_view bytes = reader.take(place.bytes);
      if (reader.good()) return bytes;
    } catch (const Damage&) {
    }
    loaded_ = kNothing;
    throw InputError("input.changed", open_.subject, "changed since it was first read", "Wait until it is complete");
  }

  [[nodiscard]] std::uint64_t heldBytes() const override {
    return unpacked_.capacity() + packed_.capacity() + channel_.capacity() * sizeof(std::size_t) +
           type_.capacity() * sizeof(std::string);
  }

 private:
  static constexpr std::size_t kUnknown = std::numeric_limits<std::size_t>::max();
  static constexpr std::uint64_t kNothing = std::numeric_limits<std::uint64_t>::max();

  [[noreturn]] void refuse(std::uint64_t at, const Damage& damage) const {
    const bool otherwise = damage.id == "recording.damaged" || damage.id == "recording.chunk";
    throw InputError(damage.id, open_.subject, "byte " + std::to_string(at) + ": " + damage.problem,
                     otherwise ? "Copy the file again, or use allow_truncated to read what comes before"
                               : "Convert it: mcap recover or ros2 bag convert, with zstd or lz4");
  }

  [[nodiscard]] Head headAt(std::uint64_t at) const {
    std::array<char, kRecordHead> bytes;
    if (end_ - at < bytes.size()) throw Damage{"recording.damaged", "is not a record"};
    input_->read(at, bytes.data(), bytes.size());
    RecordReader reader({bytes.data(), bytes.size()});
    Head head;
    head.opcode = reader.number<unsigned char>();
    head.bytes = reader.number<std::uint64_t>();
    return head;
  }

  void cutOffAt(std::uint64_t at) {
    cut_off_ = end_ == at ? "has no end: the recorder did not close it"
                          : "ends in the middle of a record: its last " + std::to_string(end_ - at) + " bytes are lost";
  }

  /// @return whether there is more
  bool scanRecord(std::uint64_t& at, const Wanted& wanted, const Use& use) {
    if (end_ - at < kRecordHead) {
      cutOffAt(at);
      return false;
    }
    const Head head = headAt(at);
    if (head.opcode == 0) throw Damage{"recording.damaged", "is not a record"};
    if (head.opcode == mcap::kDataEnd || head.opcode == mcap::kFooter) return false;  // only the index follows
    if (head.bytes > end_ - at - kRecordHead) {
      cutOffAt(at);
      return false;
    }
    if (head.opcode == mcap::kChunk) {
      scanChunk(at, head, wanted, use);
    } else if (head.opcode == mcap::kMessage) {
      loadMessage(at, head);
      RecordReader reader(unpacked_.view());
      useMessage(reader, {.block = at}, wanted, use);
    } else if (head.opcode == mcap::kSchema || head.opcode == mcap::kChannel) {
      if (head.bytes > kMostRecordBytes)
        throw Damage{"recording.damaged",
                     "a schema or channel has " + std::to_string(head.bytes) + " bytes, more than 16 MiB"};
      loaded_ = kNothing;
      char* const to = unpacked_.reset(static_cast<std::size_t>(head.bytes));
      input_->read(at + kRecordHead, to, static_cast<std::size_t>(head.bytes));
      learn(head.opcode, unpacked_.view());
    }
    at += kRecordHead + head.bytes;
    return true;
  }

  void loadMessage(std::uint64_t at, const Head& head) {
    if (head.bytes > kMostChunkBytes)
      throw Damage{"recording.chunk", "a message declares " + std::to_string(head.bytes) + " bytes, more than 1 GiB"};
    loaded_ = kNothing;
    char* const to = unpacked_.reset(static_cast<std::size_t>(head.bytes));
    input_->read(at + kRecordHead, to, static_cast<std::size_t>(head.bytes));
    loaded_ = at;
  }

  /// @param check  the checksum too: once is enough
  void loadChunk(std::uint64_t at, const Head& head, bool check) {
    loaded_ = kNothing;
    std::array<char, kChunkHead + 4 + kMostWord + 8> first;
    const std::size_t read = static_cast<std::size_t>(std::min<std::uint64_t>(first.size(), head.bytes));
    input_->read(at + kRecordHead, first.data(), read);
    RecordReader reader({first.data(), read});
    (void)reader.take(16);  // times of the first and last message
    const auto declared = reader.number<std::uint64_t>();
    const auto crc = reader.number<std::uint32_t>();
    const std::string_view word = reader.text();
    const auto packed_bytes = reader.number<std::uint64_t>();
    const std::uint64_t begin = read - reader.rest().size();
    if (!reader.good() || packed_bytes > head.bytes - begin)
      throw Damage{"recording.damaged", "a chunk is shorter than its parts"};
    if (std::max(declared, packed_bytes) > kMostChunkBytes)
      throw Damage{"recording.chunk",
                   "a chunk declares " + std::to_string(std::max(declared, packed_bytes)) + " bytes, more than 1 GiB"};
    const std::optional<ChunkCompression> compression = compressionFrom(word);
    if (!compression)
      throw Damage{"recording.compression", "a chunk is compressed by '" + wordFrom(word) + "', which is not known"};
    const bool plain = *compression == ChunkCompression::None && packed_bytes == declared;
    ByteBuffer& target = plain ? unpacked_ : packed_;
    input_->read(at + kRecordHead + begin, target.reset(static_cast<std::size_t>(packed_bytes)),
                 static_cast<std::size_t>(packed_bytes));
    if (!plain) {
      const std::string problem = unpack(*compression, packed_.view(), declared, unpacked_);
      if (!problem.empty()) throw Damage{"recording.chunk", "a chunk " + problem};
      if (packed_.capacity() > kKeptBytes) packed_.release();
    }
    if (check && crc != 0 && mcap::crc32Of(unpacked_.view()) != crc)
      throw Damage{"recording.chunk", "a chunk does not have the checksum that it declares"};
    loaded_ = at;
  }

  void scanChunk(std::uint64_t at, const Head& head, const Wanted& wanted, const Use& use) {
    loadChunk(at, head, true);
    const std::string_view all = unpacked_.view();
    RecordReader reader(all);
    while (!reader.rest().empty()) {
      const auto opcode = reader.number<unsigned char>();
      const std::string_view content = reader.take(reader.number<std::uint64_t>());
      if (!reader.good()) throw Damage{"recording.damaged", "a record in a chunk is longer than the chunk"};
      if (opcode == mcap::kMessage) {
        RecordReader message(content);
        const auto offset = static_cast<std::uint32_t>(content.data() - all.data());
        useMessage(message, {.block = at, .offset = offset}, wanted, use);
      } else {
        learn(opcode, content);
      }
    }
  }

  void useMessage(RecordReader& reader, Place place, const Wanted& wanted, const Use& use) {
    constexpr std::uint32_t kMessageHead = 22;
    const auto channel = reader.number<std::uint16_t>();
    (void)reader.number<std::uint32_t>();  // sequence
    const auto logged = reader.number<std::uint64_t>();
    (void)reader.number<std::uint64_t>();  // publish time
    if (!reader.good()) throw Damage{"recording.damaged", "a message is shorter than its head"};
    if (channel_[channel] == kUnknown)
      throw Damage{"recording.damaged",
                   "a message belongs to channel " + std::to_string(channel) + ", which is unknown"};
    const std::size_t topic = channel_[channel];
    const auto logged_ns = static_cast<std::int64_t>(logged);
    count(topic, logged_ns);
    if (!wanted(topics_[topic])) return;
    place.offset += kMessageHead;
    place.bytes = static_cast<std::uint32_t>(reader.rest().size());
    use({topic, logged_ns, reader.rest(), place});
  }

  void learn(unsigned char opcode, std::string_view content) {
    RecordReader reader(content);
    if (opcode == mcap::kSchema) {
      const auto id = reader.number<std::uint16_t>();
      const std::string_view name = reader.text();
      if (!reader.good() || name.size() > 256) throw Damage{"recording.damaged", "a schema has no valid name"};
      type_[id] = name;
    } else if (opcode == mcap::kChannel) {
      const auto id = reader.number<std::uint16_t>();
      const auto schema = reader.number<std::uint16_t>();
      const std::string_view name = reader.text();
      const std::string_view encoding = reader.text();
      if (!reader.good() || name.size() > 4096 || encoding.size() > 64)
        throw Damage{"recording.damaged", "a channel has no valid name"};
      const auto topic = addTopic(name, type_[schema], encoding);
      if (!topic) throw Damage{"recording.damaged", "there are more topics than a recorder writes"};
      channel_[id] = *topic;
    }
  }

  /// Packed chunks up to this size keep their memory for the next.
  static constexpr std::size_t kKeptBytes = std::size_t{16} << 20;

  std::unique_ptr<ByteInput> input_;
  OpenRecording open_;
  std::uint64_t end_;
  std::vector<std::size_t> channel_;  ///< [id] topic
  std::vector<std::string> type_;     ///< [id of the schema]
  ByteBuffer packed_, unpacked_;
  std::uint64_t loaded_ = kNothing;  ///< which chunk or message is unpacked
};

}  // namespace

std::unique_ptr<Recording> openMcap(std::unique_ptr<ByteInput> input, const OpenRecording& open) {
  return std::make_unique<McapReader>(std::move(input), open);
}

}  // namespace accessvdb::bags
