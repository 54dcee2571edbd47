// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The promise of AccessibilityField::updateAsync().
#pragma once

#include <memory>

#include "accessvdb/export.h"
#include "accessvdb/types.h"

namespace accessvdb {
namespace internal {
class BackgroundUpdate;
struct UpdateState;
}  // namespace internal

/// An update that may still be running. It belongs to no particular field object: the field may be moved or destroyed
/// meanwhile, and the ticket keeps the answer. Different tickets may be used from different threads, also while the
/// field is used from another one; a single ticket serves one thread at a time.
class ACCESSVDB_API UpdateTicket {
 public:
  /// Nothing to wait for.
  UpdateTicket() noexcept;
  /// Waits; an error of the update that wait() has not reported is lost.
  ~UpdateTicket();
  UpdateTicket(UpdateTicket&&) noexcept;
  /// Waits for the update that this ticket stood for.
  UpdateTicket& operator=(UpdateTicket&&) noexcept;

  /// Waits until the update has ended. May be called again, with the same outcome.
  /// @throws what the update threw; the field is then broken, as after an update() that failed
  /// @throws InvalidArgument "update.no_ticket" if there is nothing to wait for
  UpdateStats wait() const;
  /// Whether wait() would return or throw at once; true if there is nothing to wait for.
  [[nodiscard]] bool done() const;
  /// Whether there is an update, running or not.
  [[nodiscard]] bool valid() const { return state_ != nullptr; }

 private:
  friend class internal::BackgroundUpdate;
  explicit UpdateTicket(std::shared_ptr<internal::UpdateState> state) noexcept;
  void settle() const noexcept;

  std::shared_ptr<internal::UpdateState> state_;
};

}  // namespace accessvdb
