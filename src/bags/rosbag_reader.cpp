// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// ROS 1 bags, version 2.0: http://wiki.ros.org/Bags/Format/2.0
///
/// A line of text, then records: length (4 bytes) and fields "name=value", length (4) and data. Messages and their
/// connections are records inside of chunks. The index behind the chunks is not used.
#include <array>
#include <limits>
#include <unordered_map>

#include "accessvdb/error.h"
#include "bags/byte_buffer.h"
#include "bags/chunk_bytes.h"
#include "bags/record_reader.h"
#include "bags/recording.h"

namespace accessvdb::bags {
namespace {

constexpr std::string_view kMagic = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMostHeaderBytes = 1U << 20;

enum Op : unsigned char {
  kMessageData = 2,
  kBagHeader = 3,
  kIndexData = 4,
  kChunk = 5,
  kChunkInfo = 6,
  kConnection = 7
};

struct Damage {
  std::string id, problem;
};
Damage damaged(const std::string& problem) { return {"recording.damaged", problem}; }

/// The fields of a header: length (4 bytes), name, '=', value.
class Fields {
 public:
  explicit Fields(std::string_view bytes) : bytes_(bytes) {}

  /// @return empty if there is none of that name
  [[nodiscard]] std::string_view text(std::string_view name) const {
    RecordReader reader(bytes_);
    while (!reader.rest().empty()) {
      const std::string_view field = reader.text();
      if (!reader.good()) throw damaged("a header is shorter than its fields");
      if (field.size() > name.size() && field.substr(0, name.size()) == name && field[name.size()] == '=')
        return field.substr(name.size() + 1);
    }
    return {};
  }
  template <typename T>
  [[nodiscard]] T number(std::string_view name) const {
    const std::string_view value = text(name);
    if (value.size() != sizeof(T)) throw damaged("a header has no '" + std::string(name) + "'");
    return RecordReader(value).number<T>();
  }

 private:
  std::string_view bytes_;
};

class RosBagReader final : public Recording {
 public:
  RosBagReader(std::unique_ptr<ByteInput> input, const OpenRecording& open)
      : input_(std::move(input)), open_(open), end_(input_->size()) {
    std::array<char, kMagic.size()> magic = {};
    if (end_ >= magic.size()) input_->read(0, magic.data(), magic.size());
    const std::string_view begin(magic.data(), magic.size());
    if (begin == kMagic) return;
    const bool older = begin.substr(0, 8) == "#ROSBAG ";
    throw InputError("recording.format", open_.subject,
                     older ? "is a ROS bag of version '" + wordFrom(begin.substr(8, 4)) + "', not 2.0"
                           : "is not a ROS 1 bag: it does not begin with #ROSBAG V2.0",
                     older ? "Convert it: rosbag fix" : "Check the file's name, or copy it again");
  }

  void scan(const Wanted& wanted, const Use& use) override {
    std::uint64_t at = kMagic.size();
    try {
      while (at < end_ && scanRecord(at, wanted, use)) {
      }
      if (!cut_off_ && !closed_) cut_off_ = "has no end: the recorder did not close it";
    } catch (const Damage& damage) {
      if (!open_.allow_truncated) refuse(at, damage);
      cut_off_ = "is damaged at byte " + std::to_string(at) + " of " + std::to_string(end_);
    }
  }

  [[nodiscard]] std::string_view read(const Place& place) override {
    try {
      if (place.block != loaded_) {
        const auto record = recordAt(place.block);
        if (!record) throw damaged("");
        if (opOf(*record) == kChunk) {
          loadChunk(*record);
        } else {
          loadData(*record);
        }
        loaded_ = place.block;
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

  [[nodiscard]] std::uint64_t heldBytes() const override { return unpacked_.capacity() + packed_.capacity(); }

 private:
  static constexpr std::uint64_t kNothing = std::numeric_limits<std::uint64_t>::max();
  static constexpr std::size_t kKeptBytes = std::size_t{16} << 20;

  struct Record {
    std::string header;
    std::uint64_t data = 0;  ///< its first byte in the file
    std::uint32_t data_bytes = 0;
    [[nodiscard]] std::uint64_t end() const { return data + data_bytes; }
  };

  [[noreturn]] void refuse(std::uint64_t at, const Damage& damage) const {
    const bool otherwise = damage.id == "recording.damaged" || damage.id == "recording.chunk";
    throw InputError(damage.id, open_.subject, "byte " + std::to_string(at) + ": " + damage.problem,
                     otherwise ? "Copy the file again, or use allow_truncated to read what comes before"
                     : damage.id == "recording.encrypted" ? "Decrypt it: rosbag decrypt"
                                                          : "Convert it: rosbag compress --lz4");
  }

  /// @return nothing if the file ends before the record does
  [[nodiscard]] std::optional<Record> recordAt(std::uint64_t at) const {
    const auto sizeAt = [this](std::uint64_t byte) {
      std::array<char, 4> bytes;
      input_->read(byte, bytes.data(), bytes.size());
      return RecordReader({bytes.data(), bytes.size()}).number<std::uint32_t>();
    };
    if (end_ - at < 4) return std::nullopt;
    const std::uint32_t header_bytes = sizeAt(at);
    if (header_bytes > kMostHeaderBytes)
      throw damaged("a record's header has " + std::to_string(header_bytes) + " bytes, more than 1 MiB");
    if (end_ - at - 4 < std::uint64_t{header_bytes} + 4) return std::nullopt;
    Record record;
    record.header.resize(header_bytes);
    input_->read(at + 4, record.header.data(), header_bytes);
    record.data = at + 8 + header_bytes;
    record.data_bytes = sizeAt(record.data - 4);
    if (record.data_bytes > end_ - record.data) return std::nullopt;
    return record;
  }

  static unsigned char opOf(const Record& record) { return Fields(record.header).number<unsigned char>("op"); }

  bool scanRecord(std::uint64_t& at, const Wanted& wanted, const Use& use) {
    const std::optional<Record> record = recordAt(at);
    if (!record) {
      cut_off_ = "ends in the middle of a record: its last " + std::to_string(end_ - at) + " bytes are lost";
      return false;
    }
    const unsigned char op = opOf(*record);
    if (op == kBagHeader) {
      const Fields fields(record->header);
      if (const std::string_view by = fields.text("encryptor"); !by.empty())
        throw Damage{"recording.encrypted", "is encrypted by '" + wordFrom(by) + "'"};
      closed_ = fields.number<std::uint64_t>("index_pos") != 0;
    } else if (op == kChunk) {
      loadChunk(*record);
      loaded_ = at;
      scanChunk(at, wanted, use);
    } else if (op == kMessageData || op == kConnection) {
      loadData(*record);
      loaded_ = at;
      scanData(op, Fields(record->header), unpacked_.view(), {.block = at}, wanted, use);
    } else if (op != kIndexData && op != kChunkInfo) {
      throw damaged("is not a record: op " + std::to_string(op));
    }
    at = record->end();
    return true;
  }

  void loadData(const Record& record) {
    loaded_ = kNothing;
    if (record.data_bytes > kMostChunkBytes)
      throw Damage{"recording.chunk", "a message has " + std::to_string(record.data_bytes) + " bytes, more than 1 GiB"};
    input_->read(record.data, unpacked_.reset(record.data_bytes), record.data_bytes);
  }

  void loadChunk(const Record& record) {
    loaded_ = kNothing;
    const Fields fields(record.header);
    const std::string_view word = fields.text("compression");
    const auto declared = fields.number<std::uint32_t>("size");
    if (std::max(declared, record.data_bytes) > kMostChunkBytes)
      throw Damage{"recording.chunk", "a chunk declares " + std::to_string(std::max(declared, record.data_bytes)) +
                                          " bytes, more than 1 GiB"};
    const std::optional<ChunkCompression> compression = compressionFrom(word);
    if (!compression)
      throw Damage{"recording.compression", "a chunk is compressed by '" + wordFrom(word) + "', which is not known"};
    const bool plain = *compression == ChunkCompression::None && record.data_bytes == declared;
    input_->read(record.data, (plain ? unpacked_ : packed_).reset(record.data_bytes), record.data_bytes);
    if (plain) return;
    const std::string problem = unpack(*compression, packed_.view(), declared, unpacked_);
    if (!problem.empty()) throw Damage{"recording.chunk", "a chunk " + problem};
    if (packed_.capacity() > kKeptBytes) packed_.release();
  }

  void scanChunk(std::uint64_t at, const Wanted& wanted, const Use& use) {
    const std::string_view all = unpacked_.view();
    RecordReader reader(all);
    while (!reader.rest().empty()) {
      const Fields fields(reader.text());
      const std::string_view data = reader.text();
      if (!reader.good()) throw damaged("a record in a chunk is longer than the chunk");
      const auto offset = static_cast<std::uint32_t>(data.data() - all.data());
      scanData(fields.number<unsigned char>("op"), fields, data, {.block = at, .offset = offset}, wanted, use);
    }
  }

  void scanData(unsigned char op, const Fields& fields, std::string_view data, Place place, const Wanted& wanted,
                const Use& use) {
    if (op == kConnection) {
      const std::string_view name = fields.text("topic"), type = Fields(data).text("type");
      if (name.empty() || name.size() > 4096 || type.size() > 256) throw damaged("a connection has no valid topic");
      const auto topic = addTopic(name, type, "ros1");
      if (!topic || topic_.size() > kMostConnections) throw damaged("there are more topics than a recorder writes");
      topic_[fields.number<std::uint32_t>("conn")] = *topic;
    } else if (op == kMessageData) {
      const auto connection = fields.number<std::uint32_t>("conn");
      const auto topic = topic_.find(connection);
      if (topic == topic_.end())
        throw damaged("a message belongs to connection " + std::to_string(connection) + ", which is unknown");
      RecordReader time(fields.text("time"));
      const std::int64_t seconds = time.number<std::uint32_t>(), nanoseconds = time.number<std::uint32_t>();
      const std::int64_t logged_ns = seconds * 1'000'000'000 + nanoseconds;
      if (!time.good()) throw damaged("a message has no time");
      count(topic->second, logged_ns);
      if (!wanted(topics_[topic->second])) return;
      place.bytes = static_cast<std::uint32_t>(data.size());
      use({topic->second, logged_ns, data, place});
    }
  }

  static constexpr std::size_t kMostConnections = 65536;

  std::unique_ptr<ByteInput> input_;
  OpenRecording open_;
  std::uint64_t end_;
  bool closed_ = false;
  std::unordered_map<std::uint32_t, std::size_t> topic_;  ///< of a connection
  ByteBuffer packed_, unpacked_;
  std::uint64_t loaded_ = kNothing;  ///< which chunk or message is unpacked
};

}  // namespace

std::unique_ptr<Recording> openRosBag(std::unique_ptr<ByteInput> input, const OpenRecording& open) {
  return std::make_unique<RosBagReader>(std::move(input), open);
}

}  // namespace accessvdb::bags
