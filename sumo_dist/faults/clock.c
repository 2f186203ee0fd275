// Loaded into a service before all else: shifts its wall clock by what a shared file says.
//
// Only clocks that somebody may set are shifted. sem_timedwait() takes a time of that clock, which
// the kernel knows nothing of, so it is shifted back.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static const volatile int64_t *shared_ns;

__attribute__((constructor)) static void map_offset(void) {
  const char *path = getenv("SUMO_DIST_CLOCK");
  int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
  if (file < 0) return;
  void *page = mmap(NULL, sizeof(int64_t), PROT_READ, MAP_SHARED, file, 0);
  close(file);
  if (page != MAP_FAILED) shared_ns = page;
}

static int64_t offset_ns(void) { return shared_ns ? *shared_ns : 0; }

static struct timespec plus(struct timespec when, int64_t ns) {
  const int64_t second = 1000000000;
  int64_t part = when.tv_nsec + ns % second;
  when.tv_sec += ns / second + (part >= second) - (part < 0);
  when.tv_nsec = part + (part < 0 ? second : 0) - (part >= second ? second : 0);
  return when;
}

static int real_gettime(clockid_t clock, struct timespec *now) {
  static int (*next)(clockid_t, struct timespec *);
  if (!next) next = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
  return next ? next(clock, now) : (int)syscall(SYS_clock_gettime, clock, now);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
  int failed = real_gettime(clock, now);
  int settable = clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI;
  if (!failed && settable) *now = plus(*now, offset_ns());
  return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
  (void)zone;
  struct timespec precise;
  int failed = clock_gettime(CLOCK_REALTIME, &precise);
  if (!failed && now) *now = (struct timeval){precise.tv_sec, precise.tv_nsec / 1000};
  return failed;
}

time_t time(time_t *now) {
  struct timespec precise;
  if (clock_gettime(CLOCK_REALTIME, &precise)) return (time_t)-1;
  if (now) *now = precise.tv_sec;
  return precise.tv_sec;
}

int sem_timedwait(sem_t *restrict semaphore, const struct timespec *restrict until) {
  static int (*next)(sem_t *, const struct timespec *);
  if (!next) next = (int (*)(sem_t *, const struct timespec *))dlsym(RTLD_NEXT, "sem_timedwait");
  struct timespec real = plus(*until, -offset_ns());
  return next(semaphore, &real);
}
