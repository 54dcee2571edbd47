// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What Foxglove's messages are, for files that have to say so themselves.
#pragma once

#include <string>

namespace accessvdb::io {

/// PointCloud, SceneUpdate and FrameTransform of the package foxglove, and all that is in them, as a FileDescriptorSet
/// of Protocol Buffers.
[[nodiscard]] std::string foxgloveDescriptors();

}  // namespace accessvdb::io
