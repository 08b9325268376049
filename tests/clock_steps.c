/* Preloaded into a program, it has the wall clock step forward and back: by STEP_S every PERIOD_S of the monotonic one. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <sys/time.h>
#include <time.h>

#define STEP_S 37
#define PERIOD_S 8

static int (*read_clock)(clockid_t, struct timespec *);

static time_t find_step(void) {
    struct timespec now;
    if (!read_clock) read_clock = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    read_clock(CLOCK_MONOTONIC, &now);
    return now.tv_sec / PERIOD_S % 2 ? STEP_S : 0;
}

int clock_gettime(clockid_t clock, struct timespec *time) {
    time_t step_s = find_step();
    int status = read_clock(clock, time);
    if (clock == CLOCK_REALTIME) time->tv_sec += step_s;
    return status;
}

int gettimeofday(struct timeval *restrict time, void *restrict zone) {
    struct timespec now;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &now);
    time->tv_sec = now.tv_sec;
    time->tv_usec = now.tv_nsec / 1000;
    return 0;
}
