// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <system_error>

#include "accessvdb/error.h"
#include "accessvdb/program/recording_info.h"
#include "io/recordings/recording_index.h"
#include "io/scans/scan_files.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {

bool isRecordingFile(const std::filesystem::path& path) {
  try {
    return isRecording(listScans(path).kind);
  } catch (const Error&) {
    return false;
  }
}

RecordingSummary summarizeRecording(const std::filesystem::path& path) {
  const ScanFileList list = listScans(path);
  const std::string subject = forMessage(path.native());
  if (!isRecording(list.kind))
    throw InputError("recording.format", subject, "is not a recording", "Name a .mcap, .db3 or .bag file");
  RecordingSummary summary;
  std::vector<std::unique_ptr<bags::Recording>> recordings;
  for (const auto& file : list.files) {
    summary.files.push_back(file.string());
    summary.bytes += inputFileSize(file);
    recordings.push_back(openRecording(file, list.kind, true));
  }
  const RecordingIndex index =
      indexRecording({.files = list.files, .kind = list.kind, .allow_truncated = true, .list_only = true}, recordings);
  for (const IndexedTopic& indexed : index.topics) {
    const bags::Topic& topic = indexed.topic;
    RecordingTopic shown;
    shown.name = topic.name;
    shown.type = topic.type;
    shown.encoding = topic.encoding;
    shown.messages = topic.messages;
    shown.first_s = seconds(topic.first_ns);
    shown.last_s = seconds(topic.last_ns);
    shown.frames = indexed.frames;
    shown.child_frame = indexed.child;
    shown.cloud = indexed.isReadCloud();
    shown.pose = indexed.kind && indexed.wire && !shown.cloud && *indexed.kind != bags::MessageKind::Imu;
    if (indexed.error)
      shown.problem = std::string("message ") + std::to_string(indexed.first_bad) + " " + indexed.error->what();
    if (topic.messages > 0) {
      summary.first_s = summary.messages == 0 ? shown.first_s : std::min(summary.first_s, shown.first_s);
      summary.last_s = summary.messages == 0 ? shown.last_s : std::max(summary.last_s, shown.last_s);
    }
    summary.messages += topic.messages;
    summary.topics.push_back(std::move(shown));
  }
  summary.transforms = index.transforms.links().edges(200);
  summary.warnings = index.cut_offs;
  return summary;
}

}  // namespace accessvdb::io
