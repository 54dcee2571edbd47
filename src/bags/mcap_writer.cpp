// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bags/mcap_writer.h"

#include <algorithm>
#include <ostream>

#include "bags/mcap_format.h"

namespace accessvdb::bags {
namespace {

/// The content of a record, little endian.
class Content {
 public:
  template <typename T>
  Content& number(T value) {
    for (std::size_t n = 0; n < sizeof value; ++n) {
      bytes_ += static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * n) & 255);
    }
    return *this;
  }
  Content& text(std::string_view text) {
    number(static_cast<std::uint32_t>(text.size()));
    return raw(text);
  }
  Content& raw(std::string_view bytes) {
    bytes_ += bytes;
    return *this;
  }
  [[nodiscard]] std::string record(mcap::Opcode opcode) const {
    Content head;
    head.number(static_cast<std::uint8_t>(opcode)).number(static_cast<std::uint64_t>(bytes_.size()));
    return head.bytes_ + bytes_;
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

}  // namespace

McapWriter::McapWriter(std::ostream& out, std::string_view library) : out_(out) {
  write(mcap::kMagic);
  write(Content().text("").text(library).record(mcap::kHeader));
}

void McapWriter::write(std::string_view bytes) {
  out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  crc_ = mcap::crc32Of(bytes, crc_);
  at_ += bytes.size();
}

std::uint16_t McapWriter::addSchema(std::string_view name, std::string_view encoding, std::string_view data) {
  const auto id = static_cast<std::uint16_t>(schemas_.size() + 1);  // 0 is "no schema"
  schemas_.push_back(Content().number(id).text(name).text(encoding).text(data).record(mcap::kSchema));
  write(schemas_.back());
  return id;
}

std::uint16_t McapWriter::addChannel(std::uint16_t schema, std::string_view topic, std::string_view encoding) {
  const auto id = static_cast<std::uint16_t>(channels_.size());
  channels_.push_back(
      Content().number(id).number(schema).text(topic).text(encoding).number(std::uint32_t{0}).record(mcap::kChannel));
  write(channels_.back());
  return id;
}

void McapWriter::add(std::uint16_t channel, std::uint64_t time_ns, std::string_view message) {
  const auto sequence = static_cast<std::uint32_t>(messages_[channel]++);
  const std::string record =
      Content().number(channel).number(sequence).number(time_ns).number(time_ns).raw(message).record(mcap::kMessage);
  Chunk chunk = {.begin = at_, .records_bytes = record.size(), .time_ns = time_ns, .channel = channel};
  const auto size = static_cast<std::uint64_t>(record.size());
  write(Content()
            .number(time_ns)
            .number(time_ns)
            .number(size)
            .number(mcap::crc32Of(record))
            .text("")
            .number(size)
            .raw(record)
            .record(mcap::kChunk));
  chunk.bytes = at_ - chunk.begin;
  chunk.index_begin = at_;
  const std::string entry = Content().number(time_ns).number(std::uint64_t{0}).bytes();
  write(Content().number(channel).text(entry).record(mcap::kMessageIndex));
  chunk.index_bytes = at_ - chunk.index_begin;
  chunks_.push_back(chunk);
}

void McapWriter::finish() {
  write(Content().number(crc_).record(mcap::kDataEnd));
  const std::uint64_t summary = at_;
  crc_ = 0;  // from here on of the summary
  std::string offsets;
  const auto group = [&](mcap::Opcode opcode, const std::vector<std::string>& records) {
    const std::uint64_t begin = at_;
    for (const std::string& record : records) write(record);
    if (records.empty()) return;
    offsets += Content()
                   .number(static_cast<std::uint8_t>(opcode))
                   .number(begin)
                   .number(at_ - begin)
                   .record(mcap::kSummaryOffset);
  };
  group(mcap::kSchema, schemas_);
  group(mcap::kChannel, channels_);
  std::uint64_t first_ns = chunks_.empty() ? 0 : ~std::uint64_t{0}, last_ns = 0, messages = 0;
  Content counts;
  for (const auto& [channel, count] : messages_) {
    counts.number(channel).number(count);
    messages += count;
  }
  std::vector<std::string> indexes;
  for (const Chunk& chunk : chunks_) {
    first_ns = std::min(first_ns, chunk.time_ns);
    last_ns = std::max(last_ns, chunk.time_ns);
    const std::string places = Content().number(chunk.channel).number(chunk.index_begin).bytes();
    indexes.push_back(Content()
                          .number(chunk.time_ns)
                          .number(chunk.time_ns)
                          .number(chunk.begin)
                          .number(chunk.bytes)
                          .text(places)
                          .number(chunk.index_bytes)
                          .text("")
                          .number(chunk.records_bytes)
                          .number(chunk.records_bytes)
                          .record(mcap::kChunkIndex));
  }
  group(mcap::kStatistics, {Content()
                                .number(messages)
                                .number(static_cast<std::uint16_t>(schemas_.size()))
                                .number(static_cast<std::uint32_t>(channels_.size()))
                                .number(std::uint32_t{0})
                                .number(std::uint32_t{0})
                                .number(static_cast<std::uint32_t>(chunks_.size()))
                                .number(first_ns)
                                .number(last_ns)
                                .text(counts.bytes())
                                .record(mcap::kStatistics)});
  group(mcap::kChunkIndex, indexes);
  const std::uint64_t offsets_begin = at_;
  write(offsets);
  const std::string footer =
      Content().number(summary).number(offsets_begin).number(std::uint32_t{0}).record(mcap::kFooter);
  write(std::string_view(footer).substr(0, footer.size() - sizeof(std::uint32_t)));
  write(Content().number(crc_).bytes());
  write(mcap::kMagic);
}

}  // namespace accessvdb::bags
