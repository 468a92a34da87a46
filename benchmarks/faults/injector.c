// Injector: fails one operation of a process on the files below a folder, or ends the process there.
//
// Preloaded (LD_PRELOAD) in front of the C library, so that it sees what Python, HDF5, Arrow and
// Rust write alike. `fault_arm` counts from 1; operation `at` meets what `kind` says.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum { NOTHING, IO_ERROR, FULL_DISK, KILL, POWER_LOSS };
enum { MOST_UNSYNCED = 4096 };

static char root[PATH_MAX];
static long at, count;
static int kind;
static struct { dev_t dev; ino_t ino; int fd; } unsynced[MOST_UNSYNCED];
static int unsynced_count;

void fault_arm(const char *folder, long operation, int what) {
  snprintf(root, sizeof root, "%s", folder);
  at = operation, kind = what, count = 0;
}

long fault_count(void) { return count; }

// Files below the folder that were written and not synced, and still have a name.
long fault_unsynced(void) {
  long found = 0;
  struct stat s;
  for (int i = 0; i < unsynced_count; i++)
    found += unsynced[i].fd >= 0 && fstat(unsynced[i].fd, &s) == 0 && s.st_nlink > 0;
  return found;
}

static int below(const char *path) {
  size_t n = strlen(root);
  return n && path && strncmp(path, root, n) == 0 && (path[n] == '/' || path[n] == 0);
}

static const char *of_fd(int fd, char *buffer) {
  char link[64];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t n = readlink(link, buffer, PATH_MAX - 1);
  if (n < 0) return NULL;
  buffer[n] = 0;
  return buffer;
}

static const char *of_at(int dir, const char *path, char *buffer) {
  if (!path || path[0] == '/' || dir == AT_FDCWD) return path;
  char folder[PATH_MAX];
  if (!of_fd(dir, folder)) return NULL;
  snprintf(buffer, PATH_MAX, "%.2000s/%.2000s", folder, path);
  return buffer;
}

static void mark(int fd, int dirty) {
  struct stat s;
  if (fstat(fd, &s) || !S_ISREG(s.st_mode)) return;
  for (int i = 0; i < unsynced_count; i++)
    if (unsynced[i].fd >= 0 && unsynced[i].dev == s.st_dev && unsynced[i].ino == s.st_ino) {
      if (!dirty) close(unsynced[i].fd), unsynced[i].fd = -1;
      return;
    }
  if (dirty && unsynced_count < MOST_UNSYNCED) {
    int copy = fcntl(fd, F_DUPFD_CLOEXEC, 500);
    unsynced[unsynced_count].dev = s.st_dev, unsynced[unsynced_count].ino = s.st_ino;
    unsynced[unsynced_count++].fd = copy;
  }
}

// 0: go on; -1: fail with errno. `grows`: a full disk refuses it.
static int strike(const char *path, int grows) {
  if (kind == NOTHING && !root[0]) return 0;
  if (!below(path)) return 0;
  long number = __sync_add_and_fetch(&count, 1);
  if (kind == FULL_DISK && at && number >= at && grows) {
    errno = ENOSPC;
    return -1;
  }
  if (number != at) return 0;
  if (kind == IO_ERROR) {
    errno = EIO;
    return -1;
  }
  if (kind == POWER_LOSS)
    for (int i = 0; i < unsynced_count; i++)
      if (unsynced[i].fd >= 0 && ftruncate(unsynced[i].fd, 0)) continue;
  if (kind == KILL || kind == POWER_LOSS) _exit(9);
  return 0;
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
#define ON_FD(fd, grows) { char b[PATH_MAX]; if (root[0] && strike(of_fd(fd, b), grows)) return -1; }
#define ON_PATH(path, grows) { if (root[0] && strike(path, grows)) return -1; }
#define ON_AT(dir, path, grows) { char b[PATH_MAX]; \
  if (root[0] && strike(of_at(dir, path, b), grows)) return -1; }

#define WRITES(flags) ((flags) & (O_CREAT | O_TRUNC))
#define OPEN(name) int name(const char *path, int flags, ...) { \
  va_list more; va_start(more, flags); mode_t mode = va_arg(more, mode_t); va_end(more); \
  if (WRITES(flags)) ON_PATH(path, 1) \
  return REAL(name)(path, flags, mode); }
#define OPENAT(name) int name(int dir, const char *path, int flags, ...) { \
  va_list more; va_start(more, flags); mode_t mode = va_arg(more, mode_t); va_end(more); \
  if (WRITES(flags)) ON_AT(dir, path, 1) \
  return REAL(name)(dir, path, flags, mode); }
OPEN(open) OPEN(open64) OPENAT(openat) OPENAT(openat64)

#define WRITE(name, parameters, arguments) ssize_t name parameters { \
  ON_FD(fd, 1) ssize_t n = REAL(name) arguments; \
  char b[PATH_MAX]; if (root[0] && n > 0 && below(of_fd(fd, b))) mark(fd, 1); return n; }
WRITE(write, (int fd, const void *p, size_t n_), (fd, p, n_))
WRITE(pwrite, (int fd, const void *p, size_t n_, off_t o), (fd, p, n_, o))
WRITE(pwrite64, (int fd, const void *p, size_t n_, off64_t o), (fd, p, n_, o))
WRITE(writev, (int fd, const struct iovec *p, int n_), (fd, p, n_))
WRITE(pwritev, (int fd, const struct iovec *p, int n_, off_t o), (fd, p, n_, o))

#define SYNC(name) int name(int fd) { \
  ON_FD(fd, 1) int r = REAL(name)(fd); if (root[0] && r == 0) mark(fd, 0); return r; }
SYNC(fsync) SYNC(fdatasync)

int ftruncate(int fd, off_t n) { ON_FD(fd, 1) return REAL(ftruncate)(fd, n); }
int ftruncate64(int fd, off64_t n) { ON_FD(fd, 1) return REAL(ftruncate64)(fd, n); }
int fchmod(int fd, mode_t m) { ON_FD(fd, 0) return REAL(fchmod)(fd, m); }
int chmod(const char *p, mode_t m) { ON_PATH(p, 0) return REAL(chmod)(p, m); }
int fchmodat(int d, const char *p, mode_t m, int f) { ON_AT(d, p, 0) return REAL(fchmodat)(d, p, m, f); }
int mkdir(const char *p, mode_t m) { ON_PATH(p, 1) return REAL(mkdir)(p, m); }
int mkdirat(int d, const char *p, mode_t m) { ON_AT(d, p, 1) return REAL(mkdirat)(d, p, m); }
int rmdir(const char *p) { ON_PATH(p, 0) return REAL(rmdir)(p); }
int unlink(const char *p) { ON_PATH(p, 0) return REAL(unlink)(p); }
int unlinkat(int d, const char *p, int f) { ON_AT(d, p, 0) return REAL(unlinkat)(d, p, f); }
int link(const char *p, const char *q) { ON_PATH(q, 1) return REAL(link)(p, q); }
int rename(const char *p, const char *q) { ON_PATH(q, 0) return REAL(rename)(p, q); }
int renameat(int d, const char *p, int e, const char *q) {
  ON_AT(e, q, 0) return REAL(renameat)(d, p, e, q);
}
int renameat2(int d, const char *p, int e, const char *q, unsigned f) {
  ON_AT(e, q, 0) return REAL(renameat2)(d, p, e, q, f);
}
