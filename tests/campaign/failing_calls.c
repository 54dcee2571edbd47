/* Copyright Contributors to the AccessVDB project
 * SPDX-License-Identifier: Apache-2.0
 *
 * Preloaded: makes the n-th call of a kind fail as the system would, so that every failure can be tried once.
 *
 *   LD_PRELOAD=libaccessvdb_failing_calls.so FAILING_CALLS=write:17:ENOSPC accessvdb map ...
 *
 * FAILING_CALLS        KIND:N:ERROR; KIND:N+:ERROR fails the N-th and all that follow it. ERROR of read and write may
 * be SHORT: half of the bytes, and no error. Without it nothing fails. FAILING_CALLS_COUNT  a file for two arrays of
 * uint64, one place per kind in the order of kNames: calls, and how many of them failed. It is true at any time, also
 * when the run is killed. FAILING_CALLS_TRACE  a file to which the stack of each failing call is added.
 *
 * Calls count from the beginning of main(): what the loader and static initialisers do is not the program's. Forked
 * processes count on in the same numbers, so that the n-th call fails in one of them only; programs that are started
 * run without faults. Writing to standard error never fails, because what the program says is judged. Calls that the C
 * library makes of itself (what fopen() does inside) are not seen, but its calls of malloc() are. */
#define _GNU_SOURCE
#undef _FORTIFY_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <execinfo.h>
#include <fcntl.h>
#include <pthread.h>
#include <spawn.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

/* --- What fails --- */

enum Kind {
  OPEN,
  READ,
  WRITE,
  SYNC,
  RENAME,
  TRUNCATE,
  MKDIR,
  MMAP,
  MALLOC,
  THREAD,
  FORK,
  PIPE,
  STAT,
  OPENDIR,
  UNLINK,
  CLOSE,
  KINDS
};
static const char* const kNames[KINDS] = {"open",   "read",   "write", "sync", "rename", "truncate", "mkdir",  "mmap",
                                          "malloc", "thread", "fork",  "pipe", "stat",   "opendir",  "unlink", "close"};
static const struct {
  const char* name;
  int number;
} kErrors[] = {{"EMFILE", EMFILE}, {"EACCES", EACCES}, {"EROFS", EROFS},   {"ENOSPC", ENOSPC}, {"EDQUOT", EDQUOT},
               {"EIO", EIO},       {"ENOMEM", ENOMEM}, {"EAGAIN", EAGAIN}, {"ENOENT", ENOENT}, {"SHORT", 0}};

struct Counts {
  atomic_ulong calls[KINDS], failed[KINDS];
};

static struct Counts own_counts;
static struct Counts* counts = &own_counts;
static atomic_int counting; /* main() has begun */
static int wanted_kind = KINDS, wanted_error, and_all_after, trace_file = -1;
static unsigned long wanted_call;
static _Thread_local int inside; /* what this library calls itself */

/* Whether this call has to fail; then errno is set. */
static int fails(enum Kind kind) {
  if (!atomic_load(&counting) || inside) return 0;
  const unsigned long call = atomic_fetch_add(&counts->calls[kind], 1) + 1;
  if ((int)kind != wanted_kind || (and_all_after ? call < wanted_call : call != wanted_call)) return 0;
  atomic_fetch_add(&counts->failed[kind], 1);
  if (trace_file >= 0) {
    ++inside;
    void* stack[64];
    backtrace_symbols_fd(stack, backtrace(stack, 64), trace_file);
    syscall(SYS_write, trace_file, "\n", 1);
    --inside;
  }
  errno = wanted_error;
  return 1;
}

static void readWish(const char* wish) {
  for (int kind = 0; kind < KINDS; ++kind) {
    const size_t length = strlen(kNames[kind]);
    if (strncmp(wish, kNames[kind], length) != 0 || wish[length] != ':') continue;
    char* rest;
    wanted_call = strtoul(wish + length + 1, &rest, 10);
    and_all_after = *rest == '+';
    rest += and_all_after;
    for (size_t n = 0; n < sizeof kErrors / sizeof kErrors[0]; ++n) {
      if (*rest != ':' || strcmp(rest + 1, kErrors[n].name) != 0) continue;
      wanted_error = kErrors[n].number;
      wanted_kind = kind;
    }
  }
  if (wanted_kind == KINDS) {
    fprintf(stderr, "FAILING_CALLS: cannot read \"%s\"\n", wish);
    _exit(99);
  }
}

__attribute__((constructor)) static void begin(void) {
  const char* const wish = getenv("FAILING_CALLS");
  const char* const count = getenv("FAILING_CALLS_COUNT");
  const char* const trace = getenv("FAILING_CALLS_TRACE");
  if (wish != NULL) readWish(wish);
  if (count != NULL) {
    const int file = open(count, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    void* const place = ftruncate(file, sizeof *counts) != 0
                            ? MAP_FAILED
                            : mmap(NULL, sizeof *counts, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (place != MAP_FAILED) counts = place;
    if (file >= 0) close(file);
  } else {
    void* const place = mmap(NULL, sizeof *counts, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (place != MAP_FAILED) counts = place;
  }
  if (trace != NULL) {
    void* stack[1];
    backtrace(stack, 1); /* the first call loads a library */
    trace_file = open(trace, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  }
  for (const char* const* name =
           (const char* const[]){"LD_PRELOAD", "FAILING_CALLS", "FAILING_CALLS_COUNT", "FAILING_CALLS_TRACE", NULL};
       *name != NULL; ++name)
    unsetenv(*name);
}

typedef int (*Main)(int, char**, char**);
static Main own_main;

static int countedMain(int argc, char** argv, char** environment) {
  atomic_store(&counting, 1);
  return own_main(argc, argv, environment);
}

/* The call of the C library's own function of this name, which is looked up once. */
#define REAL(type, name, ...)                   \
  ({                                            \
    static type (*real)(__VA_ARGS__);           \
    if (real == NULL) {                         \
      ++inside;                                 \
      *(void**)&real = dlsym(RTLD_NEXT, #name); \
      --inside;                                 \
    }                                           \
    real;                                       \
  })

int __libc_start_main(Main main, int argc, char** argv, void (*init)(void), void (*fini)(void),
                      void (*loader_fini)(void), void* stack_end) {
  own_main = main;
  return REAL(int, __libc_start_main, Main, int, char**, void (*)(void), void (*)(void), void (*)(void), void*)(
      countedMain, argc, argv, init, fini, loader_fini, stack_end);
}

/* --- Memory --- */

extern void* __libc_malloc(size_t);
extern void* __libc_calloc(size_t, size_t);
extern void* __libc_realloc(void*, size_t);
extern void* __libc_memalign(size_t, size_t);

void* malloc(size_t size) { return fails(MALLOC) ? NULL : __libc_malloc(size); }
void* calloc(size_t count, size_t size) { return fails(MALLOC) ? NULL : __libc_calloc(count, size); }
void* realloc(void* old, size_t size) { return fails(MALLOC) ? NULL : __libc_realloc(old, size); }
void* memalign(size_t step, size_t size) { return fails(MALLOC) ? NULL : __libc_memalign(step, size); }
void* aligned_alloc(size_t step, size_t size) { return fails(MALLOC) ? NULL : __libc_memalign(step, size); }
int posix_memalign(void** place, size_t step, size_t size) {
  const int before = errno;
  void* const got = fails(MALLOC) ? NULL : __libc_memalign(step, size);
  errno = before;
  if (got == NULL) return ENOMEM;
  *place = got;
  return 0;
}

void* mmap(void* at, size_t size, int access, int flags, int file, off_t offset) {
  return fails(MMAP) ? MAP_FAILED : (void*)syscall(SYS_mmap, at, size, access, flags, file, offset);
}
void* mmap64(void* at, size_t size, int access, int flags, int file, off_t offset) {
  return mmap(at, size, access, flags, file, offset);
}

/* --- Files by their descriptors --- */

static mode_t modeOf(int flags, va_list rest) {
  return (flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE ? va_arg(rest, mode_t) : 0;
}
static int openAt(int folder, const char* path, int flags, mode_t mode) {
  return fails(OPEN) ? -1 : (int)syscall(SYS_openat, folder, path, flags, mode);
}
#define OPEN_AS(name, folder, ...)            \
  int name(__VA_ARGS__, int flags, ...) {     \
    va_list rest;                             \
    va_start(rest, flags);                    \
    const mode_t mode = modeOf(flags, rest);  \
    va_end(rest);                             \
    return openAt(folder, path, flags, mode); \
  }
OPEN_AS(open, AT_FDCWD, const char* path)
OPEN_AS(open64, AT_FDCWD, const char* path)
OPEN_AS(openat, at, int at, const char* path)
OPEN_AS(openat64, at, int at, const char* path)
int __open_2(const char* path, int flags) { return openAt(AT_FDCWD, path, flags, 0); }
int __open64_2(const char* path, int flags) { return openAt(AT_FDCWD, path, flags, 0); }
int __openat_2(int at, const char* path, int flags) { return openAt(at, path, flags, 0); }
int __openat64_2(int at, const char* path, int flags) { return openAt(at, path, flags, 0); }
int creat(const char* path, mode_t mode) { return openAt(AT_FDCWD, path, O_CREAT | O_WRONLY | O_TRUNC, mode); }
int creat64(const char* path, mode_t mode) { return creat(path, mode); }

/* The bytes to ask for; -1: it fails. */
static ssize_t allowed(enum Kind kind, size_t size) {
  if (!fails(kind)) return (ssize_t)size;
  return wanted_error != 0 ? -1 : (ssize_t)(size / 2);
}
ssize_t read(int file, void* to, size_t size) {
  const ssize_t part = allowed(READ, size);
  return part < 0 ? -1 : syscall(SYS_read, file, to, part);
}
ssize_t pread(int file, void* to, size_t size, off_t offset) {
  const ssize_t part = allowed(READ, size);
  return part < 0 ? -1 : syscall(SYS_pread64, file, to, part, offset);
}
ssize_t pread64(int file, void* to, size_t size, off_t offset) { return pread(file, to, size, offset); }
ssize_t __read_chk(int file, void* to, size_t size, size_t room) { return size > room ? -1 : read(file, to, size); }
ssize_t __pread_chk(int file, void* to, size_t size, off_t offset, size_t room) {
  return size > room ? -1 : pread(file, to, size, offset);
}
ssize_t __pread64_chk(int file, void* to, size_t size, off_t offset, size_t room) {
  return __pread_chk(file, to, size, offset, room);
}
ssize_t readv(int file, const struct iovec* parts, int count) {
  return fails(READ) && wanted_error != 0 ? -1 : syscall(SYS_readv, file, parts, count);
}
ssize_t write(int file, const void* from, size_t size) {
  const ssize_t part = file == STDERR_FILENO ? (ssize_t)size : allowed(WRITE, size);
  return part < 0 ? -1 : syscall(SYS_write, file, from, part);
}
ssize_t pwrite(int file, const void* from, size_t size, off_t offset) {
  const ssize_t part = allowed(WRITE, size);
  return part < 0 ? -1 : syscall(SYS_pwrite64, file, from, part, offset);
}
ssize_t pwrite64(int file, const void* from, size_t size, off_t offset) { return pwrite(file, from, size, offset); }
ssize_t writev(int file, const struct iovec* parts, int count) {
  if (file != STDERR_FILENO && fails(WRITE)) {
    if (wanted_error != 0) return -1;
    return syscall(SYS_write, file, parts->iov_base, (parts->iov_len + 1) / 2);
  }
  return syscall(SYS_writev, file, parts, count);
}
/* Closing a socket or a pipe loses nothing, so that it does not fail. */
static int isFile(int file) {
  struct stat info;
  const int before = errno;
  const int known = (int)syscall(SYS_fstat, file, &info) == 0;
  errno = before;
  return known && S_ISREG(info.st_mode);
}
int close(int file) {
  const int error = isFile(file) && fails(CLOSE) ? wanted_error : 0;
  const int result = (int)syscall(SYS_close, file); /* it is closed also where that fails */
  if (error == 0) return result;
  errno = error;
  return -1;
}
int fsync(int file) { return fails(SYNC) ? -1 : (int)syscall(SYS_fsync, file); }
int fdatasync(int file) { return fails(SYNC) ? -1 : (int)syscall(SYS_fdatasync, file); }
int ftruncate(int file, off_t size) { return fails(TRUNCATE) ? -1 : (int)syscall(SYS_ftruncate, file, size); }
int ftruncate64(int file, off_t size) { return ftruncate(file, size); }
int posix_fallocate(int file, off_t offset, off_t size) {
  return fails(TRUNCATE) ? wanted_error : REAL(int, posix_fallocate, int, off_t, off_t)(file, offset, size);
}
int posix_fallocate64(int file, off_t offset, off_t size) { return posix_fallocate(file, offset, size); }

/* --- Files as streams --- */

static void markFailed(FILE* file) { file->_flags |= 0x20; /* what ferror() of the GNU C library looks at */ }

FILE* fopen(const char* path, const char* mode) {
  return fails(OPEN) ? NULL : REAL(FILE*, fopen, const char*, const char*)(path, mode);
}
FILE* fopen64(const char* path, const char* mode) { return fopen(path, mode); }
FILE* fdopen(int file, const char* mode) {
  return fails(OPEN) ? NULL : REAL(FILE*, fdopen, int, const char*)(file, mode);
}
size_t fread(void* to, size_t size, size_t count, FILE* file) {
  if (fails(READ)) {
    if (wanted_error != 0) markFailed(file);
    count = wanted_error != 0 ? 0 : count / 2;
  }
  return REAL(size_t, fread, void*, size_t, size_t, FILE*)(to, size, count, file);
}
size_t __fread_chk(void* to, size_t room, size_t size, size_t count, FILE* file) {
  return size * count > room ? 0 : fread(to, size, count, file);
}
size_t fwrite(const void* from, size_t size, size_t count, FILE* file) {
  if (file != stderr && fails(WRITE)) {
    markFailed(file);
    count = wanted_error != 0 ? 0 : count / 2;
  }
  return REAL(size_t, fwrite, const void*, size_t, size_t, FILE*)(from, size, count, file);
}
int fflush(FILE* file) {
  if (file != stderr && file != NULL && fails(WRITE)) {
    markFailed(file);
    return EOF;
  }
  return REAL(int, fflush, FILE*)(file);
}
int fclose(FILE* file) {
  const int error = fails(CLOSE) ? wanted_error : 0;
  const int result = REAL(int, fclose, FILE*)(file);
  if (error == 0) return result;
  errno = error;
  return EOF;
}

/* --- Names and folders --- */

#define BY_NAME(kind, failure, type, name, arguments, ...) \
  type name(__VA_ARGS__) { return fails(kind) ? failure : REAL(type, name, __VA_ARGS__) arguments; }

BY_NAME(RENAME, -1, int, rename, (from, to), const char* from, const char* to)
BY_NAME(RENAME, -1, int, renameat, (a, from, b, to), int a, const char* from, int b, const char* to)
BY_NAME(MKDIR, -1, int, mkdir, (path, mode), const char* path, mode_t mode)
BY_NAME(MKDIR, -1, int, mkdirat, (at, path, mode), int at, const char* path, mode_t mode)
BY_NAME(UNLINK, -1, int, unlink, (path), const char* path)
BY_NAME(UNLINK, -1, int, unlinkat, (at, path, flags), int at, const char* path, int flags)
BY_NAME(UNLINK, -1, int, remove, (path), const char* path)
BY_NAME(UNLINK, -1, int, rmdir, (path), const char* path)
BY_NAME(STAT, -1, int, stat, (path, to), const char* path, struct stat* to)
BY_NAME(STAT, -1, int, lstat, (path, to), const char* path, struct stat* to)
BY_NAME(STAT, -1, int, fstat, (file, to), int file, struct stat* to)
BY_NAME(STAT, -1, int, fstatat, (at, path, to, flags), int at, const char* path, struct stat* to, int flags)
BY_NAME(STAT, -1, int, stat64, (path, to), const char* path, struct stat64* to)
BY_NAME(STAT, -1, int, lstat64, (path, to), const char* path, struct stat64* to)
BY_NAME(STAT, -1, int, fstat64, (file, to), int file, struct stat64* to)
BY_NAME(STAT, -1, int, fstatat64, (at, path, to, flags), int at, const char* path, struct stat64* to, int flags)
BY_NAME(OPENDIR, NULL, DIR*, opendir, (path), const char* path)
BY_NAME(OPENDIR, NULL, DIR*, fdopendir, (file), int file)

/* --- Threads and processes --- */

BY_NAME(FORK, -1, pid_t, fork, (), void)
BY_NAME(PIPE, -1, int, pipe2, (ends, flags), int ends[2], int flags)
BY_NAME(PIPE, -1, int, pipe, (ends), int ends[2])
BY_NAME(THREAD, wanted_error, int, pthread_create, (thread, attributes, body, argument), pthread_t* thread,
        const pthread_attr_t* attributes, void* (*body)(void*), void* argument)
BY_NAME(FORK, wanted_error, int, posix_spawn, (pid, path, files, how, argv, environment), pid_t* pid, const char* path,
        const posix_spawn_file_actions_t* files, const posix_spawnattr_t* how, char* const* argv,
        char* const* environment)
BY_NAME(FORK, wanted_error, int, posix_spawnp, (pid, path, files, how, argv, environment), pid_t* pid, const char* path,
        const posix_spawn_file_actions_t* files, const posix_spawnattr_t* how, char* const* argv,
        char* const* environment)
