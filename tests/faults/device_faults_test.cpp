// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Makes every CUDA runtime call of a field fail once: during set-up and in the middle of a run, for lack of memory or
// because the device is lost. Runs on a fake device everywhere, and on a real one in the GPU suite, where the results
// after a tolerated failure must also equal the CPU's.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <optional>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "faults/cuda_faults.h"
#include "parity/gpu_test.h"
#include "support/walk_generator.h"

namespace accessvdb::test {
namespace {

constexpr int kFrames = 3;
/// Limit on the cases of a sweep: a sweep of hundreds of calls takes seconds on any device.
constexpr std::uint64_t kMostCases = 250;

/// How points are chosen. Each way has its own arrays and kernels.
struct Choice {
  const char* name;
  UpdatePolicy policy = UpdatePolicy::Exact;
  int budget_points = 0;
  std::uint64_t most_cases = kMostCases;
  bool as_the_cpu = true;  ///< the labels equal the CPU's after every update
  const char* orientations = "yaw";
  bool leads = false;  ///< the device fuses first; not on the fake one, which runs no kernels
};
const Choice kExact = {"exact"};
const Choice kChoices[] = {
    kExact,
    {"exact, by a queue", UpdatePolicy::Exact, 1'000'000, 60},
    {"exact, with a budget", UpdatePolicy::Exact, 300, 60, false},  // different points wait than on the CPU
    {"paper, with a budget", UpdatePolicy::Paper, 300, 60},
    {"exact, with more directions than a mask holds", UpdatePolicy::Exact, 0, 60, true, "sphere:10"},
    {"exact, led by the device", UpdatePolicy::Exact, 0, kMostCases, true, "yaw", true}};

FieldParams paramsOn(BackendKind backend, const Choice& choice = kExact) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.update.policy = choice.policy;
  params.update.budget_points = choice.budget_points;
  params.approach.orientations = OrientationSet::parse(choice.orientations);
  params.backend = backend;
  params.mirror_distance = !choice.leads;  // its calls can fail like all others
  return params;
}

const ToolGeometry& tool() {
  static const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  return tool;
}

const std::vector<WalkFrame>& frames() {
  static const std::vector<WalkFrame> frames = [] {
    WalkOptions options;
    options.frames = kFrames;
    options.rays_per_frame = 2000;
    options.max_range_m = 8;
    return allFrames(options);
  }();
  return frames;
}

/// The expected state of a field after each frame, from one that never used a GPU.
struct Reference {
  std::vector<FieldSnapshot> after;  ///< [kFrames]
  explicit Reference(const Choice& choice) {
    AccessibilityField field(tool(), paramsOn(BackendKind::Cpu, choice));
    for (const WalkFrame& frame : frames()) {
      field.integrateScan(frame.points_S, frame.T_W_S);
      field.update();
      after.push_back(field.snapshot());
    }
  }
  static const Reference& get(const Choice& choice = kExact) {
    static std::map<std::string, Reference> references;
    return references.try_emplace(choice.name, choice).first->second;
  }
};

void expectSamePlaces(const FieldSnapshot& field, const FieldSnapshot& expected) {
  ASSERT_EQ(field.points.size(), expected.points.size());
  for (std::size_t n = 0; n < expected.points.size(); ++n) {
    ASSERT_EQ(field.points[n].position_W, expected.points[n].position_W) << n;
    ASSERT_EQ(field.points[n].weight, expected.points[n].weight) << n;
  }
}

void expectSameLabels(const FieldSnapshot& field, const FieldSnapshot& expected) {
  expectSamePlaces(field, expected);
  for (std::size_t n = 0; n < expected.points.size(); ++n) {
    ASSERT_EQ(field.points[n].label, expected.points[n].label) << n;
    ASSERT_EQ(field.points[n].reason, expected.points[n].reason) << n;
  }
}

class DeviceFaults : public GpuTest {
 protected:
  void SetUp() override {
    setFault({});
    GpuTest::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    held_ = cudaObjects();
    Reference::get();
    is_fake_ = AccessibilityField(tool(), paramsOn(BackendKind::Cuda)).deviceName() == "cuda:a fake";
  }
  void TearDown() override { setFault({}); }

  void expectNothingLeaked() const {
    EXPECT_EQ(cudaObjects(), held_) << "before: " << inWords(held_) << "; now: " << inWords(cudaObjects());
  }

  /// Checks a device error: its code, one line, and advice.
  static void expectUseful(const Error& error) {
    EXPECT_EQ(error.subject(), "cuda");
    EXPECT_TRUE(error.code() == ErrorCode::Device || error.code() == ErrorCode::Resource) << error.what();
    EXPECT_NE(error.advice().find("BackendKind::Cpu"), std::string::npos) << error.what();
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }

  struct Calls {
    std::uint64_t set_up = 0, run = 0;
  };
  /// Calls of a run without failures. The second run counts: libraries query some things once per process.
  static Calls healthyCalls(const Choice& choice = kExact) {
    Calls calls;
    for (int run = 0; run < 2; ++run) {
      setFault({});
      AccessibilityField field(tool(), paramsOn(BackendKind::Cuda, choice));
      calls.set_up = callsMade();
      setFault({});
      for (const WalkFrame& frame : frames()) {
        field.integrateScan(frame.points_S, frame.T_W_S);
        field.update();
      }
      static_cast<void>(field.snapshot());
      calls.run = callsMade();
    }
    return calls;
  }

  /// How a run on the GPU with a fault ended.
  struct Ending {
    bool refused = false;
    int frame = -1;  ///< in which it failed; kFrames = afterwards
    ErrorCode code = ErrorCode::Internal;
  };

  /// Runs all frames with a fault; in any case, no label may be wrong and nothing may be left behind.
  Ending runWith(const CudaFault& fault, const Choice& choice) const {
    Ending ending;
    SCOPED_TRACE(std::string(choice.name) + ", call " + std::to_string(fault.nth) + (fault.lost ? ", lost" : ""));
    setFault({});
    {
      AccessibilityField field(tool(), paramsOn(BackendKind::Cuda, choice));
      setFault(fault);
      std::optional<FieldSnapshot> labels;
      try {
        for (ending.frame = 0; ending.frame < kFrames; ++ending.frame) {
          const WalkFrame& frame = frames()[static_cast<std::size_t>(ending.frame)];
          field.integrateScan(frame.points_S, frame.T_W_S);
          field.update();
        }
        labels = field.snapshot();
      } catch (const Error& error) {
        ending.refused = true;
        ending.code = error.code();
        expectUseful(error);
      }
      SCOPED_TRACE("in " + faultyCall());
      if (ending.refused) {
        if (ending.frame < kFrames) {
          EXPECT_THROW(field.update(), Error);
          EXPECT_THROW(static_cast<void>(field.snapshot()), Error);
          EXPECT_THROW(field.integrateScan(frames()[0].points_S, frames()[0].T_W_S), Error);
        }
        const FieldSnapshot saved = field.unscoredSnapshot();
        EXPECT_EQ(saved.count(PointLabel::Unscored), saved.points.size());
        expectSamePlaces(saved,
                         Reference::get(choice).after[static_cast<std::size_t>(std::min(ending.frame, kFrames - 1))]);
      } else if (!is_fake_ && choice.as_the_cpu) {
        expectSameLabels(*labels, Reference::get(choice).after.back());
      }
    }
    expectNothingLeaked();
    return ending;
  }

  bool is_fake_ = false;
  CudaObjects held_;
};

TEST_F(DeviceFaults, AHealthyRunGivesEverythingBack) {
  const Calls calls = healthyCalls();
  EXPECT_GT(calls.set_up, 30u);
  EXPECT_GT(calls.run, 30u);
  expectNothingLeaked();
}

TEST_F(DeviceFaults, AutoIsOnTheCpuWhateverFailsAtTheStart) {
  const std::uint64_t calls = healthyCalls().set_up;
  for (const bool lost : {true, false}) {
    int on_cpu = 0;
    for (std::uint64_t nth = 1; nth <= calls; ++nth) {
      setFault({lost ? cudaErrorUnknown : cudaErrorMemoryAllocation, nth, "", lost});
      {
        AccessibilityField field(tool(), paramsOn(BackendKind::Auto));
        SCOPED_TRACE(std::to_string(nth) + " " + faultyCall());
        EXPECT_TRUE(faultMet());
        const bool cpu = field.deviceName() == "cpu";
        on_cpu += cpu;
        if (lost) {
          EXPECT_TRUE(cpu);  // without memory it may also make do with less
        }
        EXPECT_EQ(cpu, !field.deviceNote().empty());
        EXPECT_EQ(cpu, !field.deviceNoteId().empty());
        if (nth % 16 == 0 && cpu) {
          field.integrateScan(frames()[0].points_S, frames()[0].T_W_S);
          field.update();
          expectSameLabels(field.snapshot(), Reference::get().after[0]);
        }
      }
      expectNothingLeaked();
      if (HasFailure()) return;
    }
    EXPECT_GT(on_cpu, 20) << "of " << calls;
  }
}

TEST_F(DeviceFaults, CudaIsRefusedInOneLineWhateverFailsAtTheStart) {
  const std::uint64_t calls = healthyCalls().set_up;
  int refused = 0;
  for (const cudaError_t error : {cudaErrorUnknown, cudaErrorMemoryAllocation, cudaErrorNoKernelImageForDevice}) {
    for (std::uint64_t nth = 1; nth <= calls; ++nth) {
      SCOPED_TRACE(std::to_string(error) + " " + std::to_string(nth));
      setFault({error, nth, "", false});
      try {
        const AccessibilityField field(tool(), paramsOn(BackendKind::Cuda));
      } catch (const Error& thrown) {
        ++refused;
        expectUseful(thrown);
      }
      expectNothingLeaked();
      if (HasFailure()) return;
    }
  }
  EXPECT_GT(refused, 60);
}

TEST_F(DeviceFaults, SayWhatIsWrong) {
  const auto idOf = [](const CudaFault& fault) {
    setFault(fault);
    return AccessibilityField(tool(), paramsOn(BackendKind::Auto)).deviceNoteId();
  };
  EXPECT_EQ(idOf({}), "");
  EXPECT_EQ(idOf({cudaErrorInsufficientDriver, 1, "cudaGetDeviceCount", false}), "device.old_driver");
  EXPECT_EQ(idOf({cudaErrorNoDevice, 1, "cudaGetDeviceCount", false}), "device.missing");
  EXPECT_EQ(idOf({cudaErrorUnknown, 1, "cudaGetDeviceCount", true}), "device.failed");
  EXPECT_EQ(idOf({cudaErrorNoKernelImageForDevice, 1, "cudaFuncGetAttributes", false}), "device.architecture");
  EXPECT_EQ(idOf({cudaErrorUnsupportedPtxVersion, 1, "cudaFuncGetAttributes", false}), "device.architecture");
  EXPECT_EQ(idOf({cudaErrorMemoryAllocation, 1, "cudaMalloc", false}), "memory.device");
  EXPECT_EQ(idOf({cudaErrorMemoryAllocation, 1, "cuMemCreate", true}), "memory.device");
  EXPECT_EQ(idOf({cudaErrorMemoryAllocation, 1, "cudaStreamCreateWithFlags", false}), "device.memory");
}

TEST_F(DeviceFaults, ADeviceThatIsLostInTheMiddleEndsTheRunAndNotThePoints) {
  for (const Choice& choice : kChoices) {
    const std::uint64_t calls = healthyCalls(choice).run, step = calls / choice.most_cases + 1;
    int refused = 0, in_frames = 0;
    for (std::uint64_t nth = 1; nth <= calls; nth += step) {
      const Ending ending = runWith({cudaErrorLaunchFailure, nth, "", true}, choice);
      refused += ending.refused;
      in_frames += ending.refused && ending.frame < kFrames;
      // Where the device leads, all that is read last are weights, which the host's map has, too.
      const bool only_weights = choice.leads && ending.frame == kFrames;
      EXPECT_TRUE(ending.refused || only_weights) << choice.name << " " << nth << " " << faultyCall();
      if (ending.refused) {
        EXPECT_EQ(ending.code, ErrorCode::Device) << nth;
      }
      if (HasFailure()) return;
    }
    EXPECT_GT(refused, static_cast<int>(choice.most_cases) / 5) << choice.name;
    EXPECT_GT(in_frames, static_cast<int>(choice.most_cases) / 5) << choice.name;
  }
}

/// With updateAsync(): the update's ticket tells of a device that was lost in it; a scan that came beside it is in the
/// map and its points, and can still be saved.
TEST_F(DeviceFaults, ADeviceThatIsLostBesideAScanEndsTheRunAndNotThePoints) {
  for (const Choice& choice : {kChoices[0], kChoices[3], kChoices[5]}) {
    const std::uint64_t calls = healthyCalls(choice).run, step = calls / 60 + 1;
    int by_ticket = 0, by_scan = 0;
    for (std::uint64_t nth = 1; nth <= calls; nth += step) {
      SCOPED_TRACE(std::string(choice.name) + ", call " + std::to_string(nth));
      setFault({});
      {
        AccessibilityField field(tool(), paramsOn(BackendKind::Cuda, choice));
        setFault({cudaErrorLaunchFailure, nth, "", true});
        UpdateTicket ticket;
        int frame = 0;
        bool scan_refused = false;
        try {
          for (; frame < kFrames; ++frame) {
            const WalkFrame& scan = frames()[static_cast<std::size_t>(frame)];
            field.integrateScan(scan.points_S, scan.T_W_S);
            ticket = field.updateAsync();
          }
        } catch (const Error& error) {
          scan_refused = true;
          if (error.id() != "field.broken") expectUseful(error);
        }
        bool update_refused = false;
        try {
          if (ticket.valid()) static_cast<void>(ticket.wait());
        } catch (const Error& error) {
          update_refused = true;
          expectUseful(error);
          EXPECT_EQ(error.code(), ErrorCode::Device);
        }
        by_ticket += update_refused;
        by_scan += scan_refused && !update_refused;
        if (scan_refused || update_refused) {
          EXPECT_THROW(static_cast<void>(field.updateAsync()), ResourceLimit);
          EXPECT_THROW(static_cast<void>(field.snapshot()), ResourceLimit);
          EXPECT_THROW(field.integrateScan(frames()[0].points_S, frames()[0].T_W_S), ResourceLimit);
          const FieldSnapshot saved = field.unscoredSnapshot();
          EXPECT_EQ(saved.count(PointLabel::Unscored), saved.points.size());
          expectSamePlaces(saved, Reference::get(choice).after[static_cast<std::size_t>(std::min(frame, kFrames - 1))]);
        }
      }
      expectNothingLeaked();
      if (HasFailure()) return;
    }
    EXPECT_GT(by_ticket, 5) << choice.name;
    EXPECT_GT(by_scan, 5) << choice.name;
  }
}

TEST_F(DeviceFaults, NoMemoryInTheMiddleIsBorneOrRefused) {
  for (const Choice& choice : kChoices) {
    int refused = 0, borne = 0;
    for (const char* call : {"cudaMalloc", "cudaHostAlloc", "cuMemCreate"}) {
      bool all = false;
      for (std::uint64_t nth = 1; nth <= kMostCases && !all; ++nth) {
        const Ending ending = runWith({cudaErrorMemoryAllocation, nth, call, false}, choice);
        all = !faultMet();
        if (all) continue;
        (ending.refused ? refused : borne) += 1;
        if (ending.refused) {
          EXPECT_EQ(ending.code, ErrorCode::Resource) << call << " " << nth;
        }
        if (HasFailure()) return;
      }
      EXPECT_TRUE(all) << "more allocations by " << call << " than were made to fail";
    }
    EXPECT_GT(borne, 10) << choice.name;
    std::printf("%s: no memory for one allocation: %d borne, %d refused\n", choice.name, borne, refused);
  }
}

}  // namespace
}  // namespace accessvdb::test
