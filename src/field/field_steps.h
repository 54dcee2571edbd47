// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The steps that change a field: whether all of them got to their end, and the update that may run beside the others.
#pragma once

#include <exception>
#include <functional>
#include <type_traits>
#include <utility>

#include "accessvdb/error.h"
#include "field/backend_choice.h"
#include "field/background_update.h"
#include "field/query/field_views.h"

namespace accessvdb::internal {

/// For one thread at a time, as the field. Its destructor waits for the update.
class FieldSteps {
 public:
  /// @param views  of the field; out of date from the beginning of a step on
  explicit FieldSteps(FieldViews& views) : views_(views) {}

  /// @param catch_up  brings the host's map up to date, where a device is ahead of it  @param repair  what has to be
  /// done after that if the device turned out to be wrong
  void catchUpBy(std::function<void()> catch_up, std::function<void()> repair) {
    catch_up_ = std::move(catch_up);
    repair_ = std::move(repair);
  }

  /// Runs a step that changes several stages. If it fails half-way they no longer agree, and a mirror that lacks an
  /// obstacle would call points accessible: from then on the field answers nothing.
  template <typename Step>
  auto run(const Step& step) {
    settle();
    return runBesideUpdate(step);
  }
  /// The same for an update, which needs no map of the host's.
  template <typename Step>
  auto runUpdate(const Step& step) {
    settleUpdate();
    return runBesideUpdate(step);
  }
  /// The same for a step that may begin while startUpdate() runs, and calls waitForMap() and joinUpdate() itself.
  template <typename Step>
  auto runBesideUpdate(const Step& step) {
    requireUnbroken();
    views_.expire();
    whole_ = host_whole_ = false;
    try {
      if constexpr (std::is_void_v<decltype(step())>) {
        step();
        whole_ = host_whole_ = true;
      } else {
        auto result = step();
        whole_ = host_whole_ = true;
        return result;
      }
    } catch (const UpdateFailed& failed) {
      host_whole_ = failed.of_device;
      refuse();
    } catch (const Error& error) {
      // The device's work on a scan waits for the points and runs beside the map, which takes in the whole scan in any
      // case; if both fail, the host's failure is thrown (runBeside).
      host_whole_ = isOfDevice(error);
      throw;
    }
  }

  /// Begins an update on a thread of its own, after the one before. @throws ResourceLimit "field.broken"
  [[nodiscard]] UpdateTicket startUpdate(BackgroundUpdate::Work work) {
    settleUpdate();
    requireUnbroken();
    views_.expire();
    return background_.start(std::move(work));
  }
  /// Whether startUpdate() was called since the last joinUpdate(): it may read the mirror.
  [[nodiscard]] bool mayUpdate() const { return background_.begun(); }
  /// Waits until the points and the map on the host are free of the update.
  void waitForMap() const { background_.waitForMap(); }
  /// Waits for the update. Only inside a step. @throws to runBesideUpdate() if the update failed
  void joinUpdate() {
    const std::exception_ptr error = background_.take();
    if (!error) return;
    try {
      std::rethrow_exception(error);
    } catch (const Error& known) {
      throw UpdateFailed{isOfDevice(known)};
    } catch (...) {
      throw UpdateFailed{false};
    }
  }
  /// Waits for the update, and for the host's map: what follows sees what they did.
  void settle() {
    wait();
    if (whole_) attempt(repair_);
  }
  /// Only waits.
  void wait() {
    settleUpdate();
    attempt(catch_up_);
  }
  /// Waits for the update.
  void settleUpdate() {
    try {
      joinUpdate();
    } catch (const UpdateFailed& failed) {
      whole_ = false;
      host_whole_ = host_whole_ && failed.of_device;
    }
  }

  // All throw ResourceLimit "field.broken".
  /// Waits for the update.
  void requireWhole() {
    settle();
    requireUnbroken();
  }
  /// The same, but the host's map may be behind: for what needs only the points and the device's map.
  void requireUpdated() {
    settleUpdate();
    requireUnbroken();
  }
  /// Points and map on the host suffice. Waits for the update.
  void requireHostWhole() {
    settle();
    if (!host_whole_) refuse();
  }
  /// Does not wait: the update may still break the field.
  void requireUnbroken() const {
    if (!whole_) refuse();
  }

 private:
  /// Its ticket says how.
  struct UpdateFailed {
    bool of_device;
  };
  void attempt(const std::function<void()>& what) {
    if (!what) return;
    try {
      what();
    } catch (const Error& error) {
      loseToCatchUp(isOfDevice(error));
    } catch (...) {
      loseToCatchUp(false);
    }
  }
  /// Call while handling what catch_up_ or repair_ threw. If it is of the host, its scan is lost.
  void loseToCatchUp(bool of_device) {
    whole_ = false;
    host_whole_ = host_whole_ && of_device;
    if (!catch_up_failed_) catch_up_failed_ = std::current_exception();
  }
  [[noreturn]] void refuse() const {
    if (catch_up_failed_) std::rethrow_exception(catch_up_failed_);  // nobody else has told of it
    throw ResourceLimit("field.broken", "", "an earlier step failed half-way, so this field can no longer answer",
                        "Start a new field, with a larger voxel size if memory was short");
  }

  FieldViews& views_;
  std::function<void()> catch_up_, repair_;
  std::exception_ptr catch_up_failed_;
  bool whole_ = true;       ///< false once a step failed half-way
  bool host_whole_ = true;  ///< false once one failed on the host
  BackgroundUpdate background_;
};

}  // namespace accessvdb::internal
