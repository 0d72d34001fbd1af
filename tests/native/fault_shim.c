/* Preloaded into a program under test: the n-th call that writes to the disk fails, once.
 *
 * fault_arm(n, error) arms it for the calling process and forgets what was counted; fault_count()
 * says how many calls came so far. Counted are calls on regular files and folders only: pipes and
 * terminals hold the report. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static long countdown = -1, counted;
static int failure;

void fault_arm(long n, int error) {
  countdown = n;
  failure = error;
  counted = 0;
}

long fault_count(void) { return counted; }

static int fails(void) {
  ++counted;
  if (countdown < 0 || countdown-- > 0) return 0;
  errno = failure;
  return 1;
}

static int on_disk(int descriptor) {
  struct stat found;
  int kept = errno;
  int there = fstat(descriptor, &found) == 0 && (S_ISREG(found.st_mode) || S_ISDIR(found.st_mode));
  errno = kept;
  /* What lives in memory only (memfd) has no name. */
  return there && found.st_nlink > 0;
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

ssize_t write(int d, const void *data, size_t size) {
  return on_disk(d) && fails() ? -1 : REAL(write)(d, data, size);
}
ssize_t pwrite(int d, const void *data, size_t size, off_t at) {
  return on_disk(d) && fails() ? -1 : REAL(pwrite)(d, data, size, at);
}
ssize_t pwrite64(int d, const void *data, size_t size, off64_t at) {
  return on_disk(d) && fails() ? -1 : REAL(pwrite64)(d, data, size, at);
}
ssize_t writev(int d, const struct iovec *parts, int count) {
  return on_disk(d) && fails() ? -1 : REAL(writev)(d, parts, count);
}
int fsync(int d) { return on_disk(d) && fails() ? -1 : REAL(fsync)(d); }
int ftruncate(int d, off_t size) { return on_disk(d) && fails() ? -1 : REAL(ftruncate)(d, size); }
int ftruncate64(int d, off64_t size) {
  return on_disk(d) && fails() ? -1 : REAL(ftruncate64)(d, size);
}
int rename(const char *from, const char *to) { return fails() ? -1 : REAL(rename)(from, to); }
int linkat(int a, const char *from, int b, const char *to, int flags) {
  return fails() ? -1 : REAL(linkat)(a, from, b, to, flags);
}
int link(const char *from, const char *to) { return fails() ? -1 : REAL(link)(from, to); }
