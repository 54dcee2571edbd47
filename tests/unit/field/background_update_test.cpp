// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Who waits for an update that runs beside other steps, until when, and where its errors arrive.
#include "field/background_update.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "accessvdb/error.h"
#include "field/field_steps.h"

namespace accessvdb::internal {
namespace {

std::string idOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.id();
  } catch (const std::bad_alloc&) {
    return "bad_alloc";
  }
  return "no error";
}

UpdateStats scored(std::uint64_t points) {
  UpdateStats stats;
  stats.scored_points = points;
  return stats;
}

TEST(UpdateTicket, WithoutAnUpdate) {
  UpdateTicket none;
  EXPECT_FALSE(none.valid());
  EXPECT_TRUE(none.done());
  EXPECT_EQ(idOf([&] { static_cast<void>(none.wait()); }), "update.no_ticket");
  UpdateTicket moved = std::move(none);
  moved = UpdateTicket();
  EXPECT_FALSE(moved.valid());
}

/// The work goes on only when the test tells it to, so every state between is seen for certain.
TEST(BackgroundUpdate, FreesTheMapBeforeItsEnd) {
  BackgroundUpdate background;
  EXPECT_EQ(background.take(), nullptr);
  background.waitForMap();  // nothing runs
  for (std::uint64_t n = 1; n <= 3; ++n) {
    std::promise<void> free_now, end_now;
    std::atomic<bool> freed = false;
    const UpdateTicket ticket = background.start([&](const BackgroundUpdate::ReleaseMap& release_map) {
      free_now.get_future().wait();
      freed = true;
      release_map();
      end_now.get_future().wait();
      return scored(n);
    });
    EXPECT_TRUE(ticket.valid());
    EXPECT_FALSE(ticket.done());
    std::thread later([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      free_now.set_value();
    });
    background.waitForMap();
    EXPECT_TRUE(freed);
    EXPECT_FALSE(ticket.done());
    later.join();
    end_now.set_value();
    EXPECT_EQ(background.take(), nullptr);
    EXPECT_TRUE(ticket.done());
    EXPECT_EQ(ticket.wait().scored_points, n);
  }
}

TEST(BackgroundUpdate, EndingFreesTheMap) {
  BackgroundUpdate background;
  const UpdateTicket ticket = background.start([](const BackgroundUpdate::ReleaseMap&) { return scored(4); });
  background.waitForMap();
  EXPECT_TRUE(ticket.done());
  EXPECT_EQ(ticket.wait().scored_points, 4u);
}

TEST(BackgroundUpdate, AllUpdatesRunOnOneThread) {
  std::vector<std::thread::id> threads;
  UpdateTicket last;
  {
    BackgroundUpdate background;
    for (int n = 0; n < 5; ++n) {
      last = background.start([&](const BackgroundUpdate::ReleaseMap&) {
        threads.push_back(std::this_thread::get_id());
        return scored(5);
      });
      EXPECT_EQ(background.take(), nullptr);
    }
    last = background.start([&](const BackgroundUpdate::ReleaseMap&) {
      std::this_thread::sleep_for(std::chrono::milliseconds(30));
      threads.push_back(std::this_thread::get_id());
      return scored(6);
    });
  }  // waits
  ASSERT_EQ(threads.size(), 6u);
  for (const std::thread::id& thread : threads) {
    EXPECT_EQ(thread, threads.front());
    EXPECT_NE(thread, std::this_thread::get_id());
  }
  EXPECT_EQ(last.wait().scored_points, 6u);
}

/// Any thread may wait for the ticket while the field's own goes on.
TEST(BackgroundUpdate, TicketsInOtherThreads) {
  BackgroundUpdate background;
  std::vector<std::thread> waiting;
  std::atomic<std::uint64_t> sum = 0;
  for (std::uint64_t n = 1; n <= 20; ++n) {
    waiting.emplace_back([&sum, ticket = background.start([n](const BackgroundUpdate::ReleaseMap& release_map) {
      release_map();
      return scored(n);
    })] { sum += ticket.wait().scored_points; });
    background.waitForMap();
    EXPECT_EQ(background.take(), nullptr);
  }
  for (std::thread& thread : waiting) thread.join();
  EXPECT_EQ(sum, 210u);
}

struct Failure {
  const char* id;
  std::function<void()> fail;
  bool host_answers;  ///< afterwards
};

/// The ticket tells what happened, as often as it is asked; the field only says that it is broken.
TEST(FieldSteps, TheTicketReportsTheError) {
  const Failure failures[] = {
      {"device.lost", [] { throw DeviceError("device.lost", "cuda", "is gone", "Start again"); }, true},
      {"memory.device", [] { throw ResourceLimit("memory.device", "cuda", "is full", "Use --device cpu"); }, true},
      {"map.full", [] { throw ResourceLimit("map.full", "", "no room", "Use larger voxels"); }, false},
      {"bad_alloc", [] { throw std::bad_alloc(); }, false}};
  for (const Failure& failure : failures) {
    for (const bool scan_comes_beside : {false, true}) {
      SCOPED_TRACE(std::string(failure.id) + (scan_comes_beside ? ", beside a scan" : ""));
      FieldViews views;
      FieldSteps steps(views);
      steps.requireWhole();
      const std::uint64_t revision = views.revision();
      const UpdateTicket ticket = steps.startUpdate([&](const BackgroundUpdate::ReleaseMap& release_map) {
        release_map();
        failure.fail();
        return UpdateStats{};
      });
      EXPECT_GT(views.revision(), revision);
      if (scan_comes_beside) {
        bool map_changed = false;
        EXPECT_EQ(idOf([&] {
                    steps.runBesideUpdate([&] {
                      steps.waitForMap();
                      map_changed = true;
                      steps.joinUpdate();
                      ADD_FAILURE() << "the backend must not hear of the scan";
                    });
                  }),
                  "field.broken");
        EXPECT_TRUE(map_changed);
      }
      EXPECT_EQ(idOf([&] { static_cast<void>(ticket.wait()); }), failure.id);
      EXPECT_EQ(idOf([&] { static_cast<void>(ticket.wait()); }), failure.id);
      EXPECT_EQ(idOf([&] { steps.requireWhole(); }), "field.broken");
      EXPECT_EQ(idOf([&] { steps.requireUnbroken(); }), "field.broken");
      EXPECT_EQ(idOf([&] { steps.run([] {}); }), "field.broken");
      EXPECT_EQ(idOf([&] { steps.requireHostWhole(); }), failure.host_answers ? "no error" : "field.broken");
      EXPECT_EQ(idOf([&] { static_cast<void>(steps.startUpdate([](const auto&) { return UpdateStats{}; })); }),
                "field.broken");
    }
  }
}

/// If the scan fails on the host, a failing update on the device does not make the host answer again.
TEST(FieldSteps, AScanThatFailsBesideAnUpdate) {
  FieldViews views;
  FieldSteps steps(views);
  const UpdateTicket ticket = steps.startUpdate([&](const BackgroundUpdate::ReleaseMap& release_map) -> UpdateStats {
    release_map();
    throw DeviceError("device.lost", "cuda", "is gone", "Start again");
  });
  EXPECT_EQ(idOf([&] {
              steps.runBesideUpdate([&] { throw ResourceLimit("map.full", "", "no room", "Use larger voxels"); });
            }),
            "map.full");
  EXPECT_EQ(idOf([&] { static_cast<void>(ticket.wait()); }), "device.lost");
  EXPECT_EQ(idOf([&] { steps.requireHostWhole(); }), "field.broken");
}

}  // namespace
}  // namespace accessvdb::internal
