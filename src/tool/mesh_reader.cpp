// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/mesh_reader.h"

#include <assimp/BaseImporter.h>
#include <assimp/MemoryIOWrapper.h>
#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <assimp/IOSystem.hpp>
#include <assimp/Importer.hpp>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <deque>
#include <exception>
#include <mutex>
#include <new>
#include <sstream>
#include <utility>

#include "accessvdb/error.h"
#include "tool/mesh_file.h"

namespace accessvdb::internal {
namespace {

constexpr std::uint64_t kMostMemoryBytes = std::uint64_t{2} << 30, kLeastMemoryBytes = std::uint64_t{256} << 20;
constexpr std::uint64_t kMemoryPerByte = 1000;  // of the file; whole meshes take far less
constexpr rlim_t kCpuSeconds = 10;
constexpr std::chrono::seconds kWallTime{20};
constexpr std::uint64_t kMaxTriangles = 20'000'000, kMaxVertices = 60'000'000;
constexpr std::size_t kMaxErrorBytes = 1024;
constexpr const char* kMainFile = "tool_mesh";  // the name under which assimp sees the bytes; not a path, for safety

/// What the child sends first; then floats and indices, or the text of an error.
struct ChildHeader {
  std::uint64_t magic, failed, vertices, triangles, file_faces, dropped_faces, text_bytes;
};
constexpr std::uint64_t kMagic = 0x61767462'6d657368u;

/// Serves the mesh from memory, and for .gltf regular files below the mesh's own folder. Other files do not exist for
/// it.
class ConfinedFiles : public Assimp::IOSystem {
 public:
  ConfinedFiles(const MeshFile& file, std::string main_name, std::filesystem::path folder)
      : file_(file), main_name_(std::move(main_name)), folder_(std::move(folder)) {}

  bool Exists(const char* name) const override { return contentOf(name) != nullptr; }
  char getOsSeparator() const override { return '/'; }
  Assimp::IOStream* Open(const char* name, const char* mode) override {
    const std::string* content = std::strchr(mode, 'w') || std::strchr(mode, 'a') ? nullptr : contentOf(name);
    if (!content) return nullptr;
    return new Assimp::MemoryIOStream(reinterpret_cast<const std::uint8_t*>(content->data()), content->size());
  }
  void Close(Assimp::IOStream* stream) override { delete stream; }

 private:
  const std::string* contentOf(const std::string& name) const {
    if (name == main_name_) return &file_.bytes;
    if (file_.format != MeshFormat::Gltf) return nullptr;
    for (const auto& [known, content] : side_files_) {
      if (known == name) return &content;
    }
    std::error_code error;
    const std::filesystem::path root = std::filesystem::canonical(folder_, error);
    const std::filesystem::path relative(name);
    if (error || relative.is_absolute()) return nullptr;
    const std::filesystem::path target = std::filesystem::canonical(root / relative, error);
    if (error || std::mismatch(root.begin(), root.end(), target.begin(), target.end()).first != root.end()) {
      return nullptr;
    }
    std::string problem;
    std::optional<std::string> bytes = readRegularFile(target, kMaxMeshFileBytes, problem);
    if (!bytes) return nullptr;
    side_files_.emplace_back(name, std::move(*bytes));
    return &side_files_.back().second;
  }

  const MeshFile& file_;
  std::string main_name_;
  std::filesystem::path folder_;
  mutable std::deque<std::pair<std::string, std::string>> side_files_;
};

/// Keeps only one format's importers, so that no content can choose another.
void keepImporters(Assimp::Importer& importer, const std::string& extension) {
  for (std::size_t n = importer.GetImporterCount(); n-- > 0;) {
    std::istringstream endings(importer.GetImporterInfo(n)->mFileExtensions);
    bool wanted = false;
    for (std::string ending; endings >> ending;) wanted = wanted || ending == extension;
    if (!wanted) importer.UnregisterLoader(importer.GetImporter(n));
  }
}

struct ChildMesh {
  std::vector<float> vertices;
  std::vector<std::uint32_t> indices;
  std::uint64_t file_faces = 0, dropped_faces = 0;
};

/// @return an error in words, or nothing
std::string collect(const aiScene& scene, ChildMesh& out) {
  struct Placed {
    const aiNode* node;
    aiMatrix4x4t<double> T;
  };
  std::vector<Placed> open;
  if (scene.mRootNode) open.push_back({scene.mRootNode, aiMatrix4x4t<double>()});
  while (!open.empty()) {
    const Placed at = open.back();
    open.pop_back();
    const aiMatrix4x4& m = at.node->mTransformation;
    const aiMatrix4x4t<double> T = at.T * aiMatrix4x4t<double>(m.a1, m.a2, m.a3, m.a4, m.b1, m.b2, m.b3, m.b4, m.c1,
                                                               m.c2, m.c3, m.c4, m.d1, m.d2, m.d3, m.d4);
    const bool mirrored = T.Determinant() < 0;
    for (unsigned n = 0; n < at.node->mNumMeshes; ++n) {
      const unsigned index = at.node->mMeshes[n];
      if (index >= scene.mNumMeshes) return "a node refers to a mesh that does not exist";
      const aiMesh& mesh = *scene.mMeshes[index];
      const auto base = std::uint32_t(out.vertices.size() / 3);
      if (base + std::uint64_t(mesh.mNumVertices) > kMaxVertices) return "the mesh has too many vertices";
      if (out.indices.size() / 3 + mesh.mNumFaces > kMaxTriangles) return "the mesh has too many faces";
      for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
        const aiVector3D& p = mesh.mVertices[v];
        const aiVector3t<double> q = T * aiVector3t<double>(p.x, p.y, p.z);
        out.vertices.insert(out.vertices.end(), {float(q.x), float(q.y), float(q.z)});
      }
      for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
        const aiFace& face = mesh.mFaces[f];
        if (face.mNumIndices != 3) {
          ++out.dropped_faces;
          continue;
        }
        for (int c = 0; c < 3; ++c) {
          const unsigned v = face.mIndices[mirrored ? 2 - c : c];
          if (v >= mesh.mNumVertices) return "a face refers to a vertex that does not exist";
          out.indices.push_back(base + v);
        }
      }
    }
    for (unsigned n = 0; n < at.node->mNumChildren; ++n) open.push_back({at.node->mChildren[n], T});
  }
  return {};
}

/// A small file that asks for gigabytes is damaged, and clearing them takes seconds. The faces of a .gltf are beside
/// it.
std::uint64_t memoryFor(const MeshFile& file) {
  if (file.extension == "gltf") return kMostMemoryBytes;
  return std::min(kMostMemoryBytes, kLeastMemoryBytes + kMemoryPerByte * file.bytes.size());
}

std::string outOfMemory(const MeshFile& file) {
  return "reading the mesh needs more than " + std::to_string(memoryFor(file) >> 20) + " MiB of memory";
}

std::string failureOf(const Assimp::Importer& importer, const MeshFile& file) {
  const std::string text = importer.GetErrorString();
  return text.find("bad_alloc") != text.npos ? outOfMemory(file) : "the mesh is malformed: " + text;
}

/// Runs in the child. @return an error in words, or nothing
std::string import(const MeshFile& file, const std::filesystem::path& folder, ChildMesh& out) {
  const std::string name = kMainFile + ("." + file.extension);
  Assimp::Importer importer;
  keepImporters(importer, file.extension);
  importer.SetIOHandler(new ConfinedFiles(file, name, folder));
  // The user's pose is in the file's own axes, so they stay unchanged.
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
  const aiScene* scene = importer.ReadFile(name, 0);
  if (!scene) return failureOf(importer, file);
  for (unsigned n = 0; n < scene->mNumMeshes; ++n) {
    const aiMesh& mesh = *scene->mMeshes[n];
    // A face that the header announces but the file lacks has no indices.
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) out.file_faces += mesh.mFaces[f].mNumIndices > 0;
  }
  if (out.file_faces == 0) return {};
  scene = importer.ApplyPostProcessing(aiProcess_Triangulate);
  if (!scene) return failureOf(importer, file);
  return collect(*scene, out);
}

bool writeAll(int fd, const void* data, std::size_t size) {
  const char* at = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t n = ::write(fd, at, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    at += n;
    size -= std::size_t(n);
  }
  return true;
}

void limitChild([[maybe_unused]] std::uint64_t memory_bytes) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::prctl(PR_SET_DUMPABLE, 0);
  for (int number : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGINT, SIGTERM, SIGXCPU}) ::signal(number, SIG_DFL);
  ::signal(SIGPIPE, SIG_IGN);
  // assimp's assertions write to stderr, but a library stays silent.
  const int nothing = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  for (int fd = 0; nothing >= 0 && fd < 3; ++fd) ::dup2(nothing, fd);
  const rlimit core = {0, 0}, cpu = {kCpuSeconds, kCpuSeconds};
  ::setrlimit(RLIMIT_CORE, &core);
  ::setrlimit(RLIMIT_CPU, &cpu);
  // If memory still runs out, this process is killed and not its parent.
  if (const int oom = ::open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC); oom >= 0) {
    [[maybe_unused]] const bool told = writeAll(oom, "1000", 4);
    ::close(oom);
  }
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // The limit is added to what this process already maps, which may far exceed its use (GPU drivers reserve terabytes).
  unsigned long long mapped_pages = 0;
  if (std::FILE* statm = std::fopen("/proc/self/statm", "re")) {
    if (std::fscanf(statm, "%llu", &mapped_pages) != 1) mapped_pages = 0;
    std::fclose(statm);
  }
  const rlim_t bytes = rlim_t(mapped_pages) * rlim_t(::sysconf(_SC_PAGESIZE)) + memory_bytes;
  const rlimit memory = {bytes, bytes};
  ::setrlimit(RLIMIT_AS, &memory);
#endif
}

[[noreturn]] void runChild(int fd, const MeshFile& file, const std::filesystem::path& folder) {
  limitChild(memoryFor(file));
  ChildMesh mesh;
  std::string problem;
  try {
    problem = import(file, folder, mesh);
  } catch (const std::bad_alloc&) {
    problem = outOfMemory(file);
  } catch (const std::exception& error) {
    problem = std::string("the mesh is malformed: ") + error.what();
  } catch (...) {
    problem = "the mesh is malformed";
  }
  problem.resize(std::min(problem.size(), kMaxErrorBytes));
  const bool failed = !problem.empty();
  const ChildHeader header = {kMagic,
                              failed,
                              failed ? 0 : mesh.vertices.size() / 3,
                              failed ? 0 : mesh.indices.size() / 3,
                              mesh.file_faces,
                              mesh.dropped_faces,
                              problem.size()};
  const bool sent = writeAll(fd, &header, sizeof header) && writeAll(fd, problem.data(), problem.size()) &&
                    (failed || (writeAll(fd, mesh.vertices.data(), 4 * mesh.vertices.size()) &&
                                writeAll(fd, mesh.indices.data(), 4 * mesh.indices.size())));
  ::_exit(sent ? 0 : 1);
}

/// The parent's side: reads with a deadline, and always reaps the child.
class Child {
 public:
  Child(const MeshFile& file, const std::filesystem::path& folder) {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) return;
    pid_ = ::fork();
    if (pid_ == 0) {
      ::close(ends[0]);
      runChild(ends[1], file, folder);
    }
    ::close(ends[1]);
    fd_ = ends[0];
  }
  ~Child() {
    if (fd_ >= 0) ::close(fd_);
    reap(true);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  [[nodiscard]] bool started() const { return pid_ > 0; }

  bool read(void* data, std::size_t size) {
    char* at = static_cast<char*>(data);
    while (size > 0) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline_ - Clock::now()).count();
      if (left <= 0) return timed_out_ = true, false;
      pollfd waiting = {fd_, POLLIN, 0};
      const int ready = ::poll(&waiting, 1, int(left));
      if (ready < 0 && errno != EINTR) return false;
      if (ready <= 0) continue;
      const ssize_t n = ::read(fd_, at, size);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return false;
      at += n;
      size -= std::size_t(n);
    }
    return true;
  }

  /// The reason why no usable result came.
  std::string epitaph() {
    if (timed_out_) return "reading the mesh took longer than 20 s";
    reap(false);
    if (WIFSIGNALED(status_)) {
      const int number = WTERMSIG(status_);
      if (number == SIGXCPU || number == SIGKILL)
        return "reading the mesh took more than 10 s of CPU time or was stopped";
      return std::string("the mesh is malformed in a way that crashes its reader (") + ::strsignal(number) + ")";
    }
    return "reading the mesh ended without a result";
  }

 private:
  using Clock = std::chrono::steady_clock;

  void reap(bool now) {
    if (pid_ <= 0) return;
    if (now) ::kill(pid_, SIGKILL);
    while (::waitpid(pid_, &status_, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
  }

  Clock::time_point deadline_ = Clock::now() + kWallTime;
  pid_t pid_ = -1;
  int fd_ = -1, status_ = 0;
  bool timed_out_ = false;
};

/// Text from a file may contain anything.
std::string printable(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  while (!text.empty() && (text.back() == ' ' || text.back() == '.')) text.pop_back();
  return text;
}

}  // namespace

FileMesh readMeshFile(const std::filesystem::path& path) {
  const std::string subject = path.string();
  const MeshFile file = openMeshFile(path);
  const auto malformed = [&](const std::string& problem) {
    return InputError("tool.malformed", subject, printable(problem),
                      "Export the mesh again, for example as binary STL");
  };

  // One at a time: another child forked meanwhile would hold this one's pipe open.
  static std::mutex one_at_a_time;
  const std::scoped_lock lock(one_at_a_time);
  Child child(file, path.has_parent_path() ? path.parent_path() : std::filesystem::path("."));
  if (!child.started()) {
    throw ResourceLimit("tool.fork", subject, "could not start a process to read the mesh", "Free some memory");
  }
  ChildHeader header = {};
  if (!child.read(&header, sizeof header)) throw malformed(child.epitaph());
  if (header.magic != kMagic || header.text_bytes > kMaxErrorBytes || header.vertices > kMaxVertices ||
      header.triangles > kMaxTriangles) {
    throw malformed("reading the mesh ended with an invalid result");
  }
  std::string text(header.text_bytes, '\0');
  if (!child.read(text.data(), text.size())) throw malformed(child.epitaph());
  if (header.failed) throw malformed(text);
  if (file.expected_faces && *file.expected_faces != header.file_faces) {
    throw malformed("the file announces " + std::to_string(*file.expected_faces) + " faces, but " +
                    std::to_string(header.file_faces) + " could be read");
  }
  if (header.triangles == 0) {
    throw UnusableInput("tool.no_faces", subject, "the mesh has no faces, only points or lines, or nothing at all",
                        "Export the tool as a surface of triangles or polygons");
  }

  FileMesh mesh;
  mesh.vertices.resize(header.vertices);
  mesh.triangles.resize(header.triangles);
  if (!child.read(mesh.vertices.data(), 12 * header.vertices) ||
      !child.read(mesh.triangles.data(), 12 * header.triangles)) {
    throw malformed(child.epitaph());
  }
  for (const auto& triangle : mesh.triangles) {
    for (std::uint32_t v : triangle) {
      if (v >= header.vertices) throw malformed("a face refers to a vertex that does not exist");
    }
  }
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!mesh.vertices[v].allFinite()) {
      throw UnusableInput("tool.nonfinite", subject, "vertex " + std::to_string(v) + " is not finite",
                          "Export the mesh again");
    }
  }
  mesh.notes = file.notes;
  if (header.dropped_faces > 0) {
    mesh.notes.push_back(std::to_string(header.dropped_faces) + " points and lines of the mesh ignored");
  }
  mesh.metres_per_file_unit = file.metres_per_unit;
  mesh.metres_per_vertex_unit =
      file.metres_per_unit > 0 ? 1.0 : 0.0;  // assimp applies COLLADA's unit; glTF is in metres
  return mesh;
}

}  // namespace accessvdb::internal
