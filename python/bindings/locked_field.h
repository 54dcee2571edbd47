// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A field as Python sees it: calls release the interpreter's lock while they work, so several threads may call at
/// once; they take turns.
#pragma once

#include <mutex>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/tool_spec.h"
#include "bindings/arrays.h"

namespace accessvdb::python {

class LockedField {
 public:
  LockedField(const ToolGeometry& tool, const FieldParams& params) : field_(tool, params) {}
  LockedField(std::vector<ToolSpec> tools, const FieldParams& params) : field_(std::move(tools), params) {}
  explicit LockedField(AccessibilityField field) : field_(std::move(field)) {}
  LockedField(const LockedField&) = delete;
  LockedField& operator=(const LockedField&) = delete;

  /// Runs body(field) alone, without the interpreter's lock: it must not touch Python.
  template <typename Body>
  auto run(const Body& body) {
    return withoutLock([&] {
      const std::scoped_lock turn(turn_);  // taken without the interpreter's lock, or two threads would wait forever
      return body(field_);
    });
  }

  ~LockedField() {
    run([](const AccessibilityField& field) { static_cast<void>(field.volume()); });  // waits for an update_async()
  }

  /// What never changes: tool and parameters.
  [[nodiscard]] const AccessibilityField& constants() const { return field_; }

 private:
  std::mutex turn_;
  AccessibilityField field_;
};

}  // namespace accessvdb::python
