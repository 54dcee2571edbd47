// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The container of a recording: topics, and their messages one by one. Three formats, one interface; all are read from
/// beginning to end without their index, so that a file that was cut off gives what is whole in it.
///
/// Holds one chunk, or one message where there are no chunks, beside the list of topics.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "bags/byte_input.h"

namespace accessvdb::bags {

enum class Container { Mcap, RosBag, Sqlite };

struct Topic {
  std::string name;      ///< as in the file: any bytes
  std::string type;      ///< "sensor_msgs/PointCloud2", the same for ROS 1 and ROS 2
  std::string encoding;  ///< of the messages: "cdr" (ROS 2), "ros1", or another word that is not read
  std::uint64_t messages = 0;
  std::int64_t first_ns = 0, last_ns = 0;  ///< when messages were recorded, since 1970
};

/// Where a message is, so that it can be read again.
struct Place {
  std::uint64_t block = 0;   ///< byte of the chunk in the file, or of the message itself; in a database, its row
  std::uint32_t offset = 0;  ///< in the unpacked chunk
  std::uint32_t bytes = 0;
};

struct Message {
  std::size_t topic = 0;  ///< index of topics()
  std::int64_t logged_ns = 0;
  std::string_view bytes;  ///< valid until the next message
  Place place;
};

class Recording {
 public:
  virtual ~Recording() = default;
  Recording() = default;
  Recording(const Recording&) = delete;
  Recording& operator=(const Recording&) = delete;

  using Wanted = std::function<bool(const Topic&)>;
  using Use = std::function<void(const Message&)>;
  /// Reads the whole file once, in its own order. All messages are counted, and `use` gets those of wanted topics.
  /// @throws InputError "recording.format", "recording.encrypted", "recording.compression", "recording.chunk",
  ///         "recording.damaged", and what ByteInput throws
  virtual void scan(const Wanted& wanted, const Use& use) = 0;
  /// One message again; valid until the next call. @param place  from scan()
  [[nodiscard]] virtual std::string_view read(const Place& place) = 0;
  /// Those seen so far; all of them after scan().
  [[nodiscard]] const std::vector<Topic>& topics() const { return topics_; }
  /// After scan(): in words, what is missing of a file that was not finished; nothing if it is whole.
  [[nodiscard]] const std::optional<std::string>& cutOff() const { return cut_off_; }
  /// Memory that is held between reads.
  [[nodiscard]] virtual std::uint64_t heldBytes() const = 0;

 protected:
  /// The index of a topic, new or known. @return nothing where there are more than a recorder would write
  [[nodiscard]] std::optional<std::size_t> addTopic(std::string_view name, std::string_view type,
                                                    std::string_view encoding);
  void count(std::size_t topic, std::int64_t logged_ns);

  std::vector<Topic> topics_;
  std::optional<std::string> cut_off_;

 private:
  std::unordered_map<std::string, std::size_t> index_;
  std::uint64_t name_bytes_ = 0;
};

struct OpenRecording {
  std::filesystem::path path = {};  ///< beside which databases may have a journal
  std::string subject = {};         ///< the file's name for messages
  bool allow_truncated = false;     ///< what follows damage is given up as if the file were cut off there
};

/// @throws InputError as scan()
[[nodiscard]] std::unique_ptr<Recording> openMcap(std::unique_ptr<ByteInput> input, const OpenRecording& open);
[[nodiscard]] std::unique_ptr<Recording> openRosBag(std::unique_ptr<ByteInput> input, const OpenRecording& open);
[[nodiscard]] std::unique_ptr<Recording> openSqlite(std::unique_ptr<ByteInput> input, const OpenRecording& open);

/// Bytes of a file as text for a message: what is not printable ASCII becomes '?'.
[[nodiscard]] std::string wordFrom(std::string_view bytes);

}  // namespace accessvdb::bags
