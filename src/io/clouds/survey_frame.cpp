// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/survey_frame.h"

#include "accessvdb/scan_io.h"
#include "io/clouds/point_cloud.h"
#include "io/streams/sha256.h"

namespace accessvdb {

std::string SurveyFrame::systemSha256() const {
  if (!hasSystem()) return {};
  internal::Sha256 sha256;
  for (const std::string* part : {&wkt, &geo_keys, &geo_doubles, &geo_texts}) {
    const std::uint64_t bytes = part->size();
    sha256.update(&bytes, sizeof bytes);
    sha256.update(part->data(), part->size());
  }
  return internal::hexOf(sha256.digest());
}

SurveyFrame io::frameOfLas(const std::filesystem::path& file) { return *openCloud(file, ScanKind::Las, {})->frame(); }

}  // namespace accessvdb
