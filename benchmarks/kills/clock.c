// Clock: a system clock that somebody sets back and forth, in front of the C library (LD_PRELOAD).
//
// A process begins ten years late; after some calls that ask for the date each is ten years early,
// right, or late in turn. (A process that began early would find its sources edited since, and
// compile them without keeping that, which is right and slow.) The clock for durations is left alone:
// no setting of the date changes it.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <sys/time.h>
#include <time.h>

enum { FIRST = 100 };

static time_t jump(void) {
  static unsigned calls;
  unsigned n = __sync_add_and_fetch(&calls, 1);
  return (n < FIRST ? 1 : (int)(n % 3) - 1) * (time_t)315360000;
}

int clock_gettime(clockid_t clock, struct timespec *t) {
  int r = ((int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime"))(clock, t);
  if (r == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) t->tv_sec += jump();
  return r;
}

int gettimeofday(struct timeval *restrict t, void *restrict zone) {
  int r = ((int (*)(struct timeval *, void *))dlsym(RTLD_NEXT, "gettimeofday"))(t, zone);
  if (r == 0) t->tv_sec += jump();
  return r;
}

time_t time(time_t *t) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (t) *t = now.tv_sec;
  return now.tv_sec;
}
