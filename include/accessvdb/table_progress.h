// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How far the making of a tool's tables is: with many orientations of a fine mesh it takes seconds.
#pragma once

#include <cstddef>
#include <functional>

namespace accessvdb {

/// Called now and then, for one tool after the other: orientations that are done, of all of this tool; done only grows,
/// and in the end equals total. By any thread, but one at a time; it holds up the work. What it throws ends the work.
using TableProgress = std::function<void(std::size_t done, std::size_t total)>;

}  // namespace accessvdb
