/* The 1 kHz scheduler, in a thread of its own or, for exact tests, driven tick by tick; and the hooks of the tests. */
#define _GNU_SOURCE
#include "standin.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <time.h>

enum { CALLBACK_CONTINUE = 1, KEPT = 1 << 16, TICK_NS = 1000000 };

extern unsigned refuse_init, complain_init;
extern atomic_int init_ms;
extern int running;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER; /* a test's hook waits for the end of a tick */
static pthread_t thread;
static Callback callback;
static void *user_data;
static int threaded, scheduled, stalled, overrun_us, period_us = 1000;
static int dropped; /* forces that fell to nothing at once as the scheduler stopped */
static atomic_int stopping, outlives_ms, left_behind; /* how long threads call on after a stop; how many do */
static unsigned refuse_start;
static int64_t stepped_ns, durations[KEPT];
static long n_durations;

static int64_t real_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1000000000LL * now.tv_sec + now.tv_nsec;
}

static void tick(void)
{
    for (int k = 0; k < ARMS; k++) {
        move_arm(&arms[k], 1e-6 * period_us);
        arms[k].framed = 0;
    }
    if (!scheduled || stalled > 0) {
        stalled -= stalled > 0;
        return;
    }
    int64_t began = real_ns();
    scheduled = callback(user_data) == CALLBACK_CONTINUE;
    while (overrun_us > 0 && real_ns() < began + 1000LL * overrun_us) {}
    durations[n_durations++ % KEPT] = real_ns() - began;
}

/* A thread that does not end with the scheduler: it calls on with the address that it was given, as fast as it can. */
static void *call_on(void *unused)
{
    (void)unused;
    Callback function = callback;
    void *data = user_data;
    int64_t until = real_ns() + 1000000LL * atomic_load(&outlives_ms);
    while (real_ns() < until) {
        function(data);
        nanosleep(&(struct timespec){0, 100000L}, NULL);
    }
    atomic_fetch_sub(&left_behind, 1);
    return NULL;
}

static void *run(void *unused)
{
    (void)unused;
    for (int64_t due = real_ns() + TICK_NS; !atomic_load(&stopping); due += TICK_NS) {
        if (due < real_ns())
            due = real_ns(); /* no burst */
        struct timespec at = {due / 1000000000LL, due % 1000000000LL};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL);
        pthread_mutex_lock(&lock);
        tick();
        pthread_mutex_unlock(&lock);
    }
    return NULL;
}

unsigned long hdScheduleAsynchronous(Callback function, void *data, unsigned short priority)
{
    (void)priority;
    callback = function;
    user_data = data;
    scheduled = 1;
    return 1;
}

void hdUnschedule(unsigned long handle)
{
    (void)handle;
    if (!scheduled)
        raise_error(0x0102, 0); /* invalid operation: it has ended by itself */
    scheduled = 0;
}

void hdSetSchedulerRate(unsigned long hz)
{
    if (hz != 1000)
        raise_error(0x0101, 0);
}

void hdStartScheduler(void)
{
    if (refuse_start) {
        raise_error(refuse_start, 0);
        return;
    }
    running = 1;
    atomic_store(&stopping, 0);
    if (threaded)
        pthread_create(&thread, NULL, run, NULL);
}

void hdStopScheduler(void)
{
    if (running && threaded) {
        atomic_store(&stopping, 1);
        pthread_join(thread, NULL);
    }
    if (running && atomic_load(&outlives_ms) > 0) {
        pthread_t other;
        atomic_fetch_add(&left_behind, 1);
        if (pthread_create(&other, NULL, call_on, NULL) == 0)
            pthread_detach(other);
    }
    pthread_mutex_lock(&lock); /* not in the middle of a tick that a test drives */
    running = 0;
    for (int k = 0; k < ARMS; k++) {
        double *f = arms[k].force;
        dropped += arms[k].motors && (f[0] != 0.0 || f[1] != 0.0 || f[2] != 0.0);
        memset(f, 0, sizeof arms[k].force);
    }
    pthread_mutex_unlock(&lock);
}

/* hooks */

void standin_reset(int with_thread)
{
    threaded = with_thread;
    for (int k = 0; k < ARMS; k++) {
        arms[k] = (StandInArm){.max_force = 8.5, .style = 2, .dof = 6};
        arms[k].gimbal[2] = 0.25;
    }
}

/* As a process finds it that knows of no hooks. */
__attribute__((constructor)) static void begin(void)
{
    standin_reset(1);
}

void standin_tick(int64_t now_ns)
{
    pthread_mutex_lock(&lock);
    stepped_ns = now_ns;
    if (running && !threaded)
        tick();
    pthread_mutex_unlock(&lock);
}

int standin_gettime(int which, struct timespec *now)
{
    if (threaded)
        return clock_gettime((clockid_t)which, now);
    *now = (struct timespec){stepped_ns / 1000000000LL, stepped_ns % 1000000000LL};
    return 0;
}

#define HOOK(name, parameters, action) \
    void name parameters { pthread_mutex_lock(&lock); action; pthread_mutex_unlock(&lock); }

HOOK(standin_inject, (int k, unsigned code), arms[k].inject = code)
HOOK(standin_inject_every, (int k, unsigned code), arms[k].inject_every = code)
HOOK(standin_raise, (unsigned code, int k), raise_error(code, arms[k].handle))
HOOK(standin_unplug, (int k, int yes), arms[k].unplugged = yes)
/* As the library does when a USB arm goes away: nothing knows its handle any more. */
HOOK(standin_pull, (int k), arms[k].unplugged = 1; arms[k].open = arms[k].motors = arms[k].in_frame = 0)
/* A handle that is unknown though the device is there, and holds what it was told last. */
HOOK(standin_forget, (int k, int yes), arms[k].open = !yes)
/* 1: position; 2: angles and temperatures; 3: all. */
HOOK(standin_not_a_number, (int k, int what), arms[k].not_a_number = what)
HOOK(standin_lack, (int k, int parameter), arms[k].lacks = parameter)
HOOK(standin_style, (int k, int style), arms[k].style = style)
HOOK(standin_inkwell, (int k, int yes), arms[k].in_inkwell = yes)
HOOK(standin_uncalibrate, (int k), arms[k].calibration = 0x5001)
HOOK(standin_buttons, (int k, int buttons), arms[k].buttons = buttons)
HOOK(standin_heat, (int k, double share), arms[k].temperature = share)
HOOK(standin_dry, (int k, double friction_n), arms[k].dry = friction_n)
HOOK(standin_max_force, (int k, double force), arms[k].max_force = force)
HOOK(standin_hand, (int k, const double *at), memcpy(arms[k].hand, at, sizeof arms[k].hand))
HOOK(standin_place, (int k, const double *at), memcpy(arms[k].position, at, sizeof arms[k].position);
     memcpy(arms[k].hand, at, sizeof arms[k].hand); memset(arms[k].velocity, 0, sizeof arms[k].velocity))
/* Positions of the next frames are wrong by so much. */
HOOK(standin_wrong, (int k, const double *by, int frames), memcpy(arms[k].wrong, by, sizeof arms[k].wrong);
     arms[k].wrong_frames = frames)
HOOK(standin_stall, (int ticks), stalled = ticks)
/* How far apart the ticks are that a test drives: a library that does not keep to the rate that it was told. */
HOOK(standin_period_us, (int us), period_us = us)
HOOK(standin_overrun, (int us), overrun_us = us)
HOOK(standin_outlive, (int ms), atomic_store(&outlives_ms, ms))
HOOK(standin_refuse_init, (unsigned code), refuse_init = code)
HOOK(standin_complain_init, (unsigned code), complain_init = code)
HOOK(standin_init_ms, (int ms), init_ms = ms)
HOOK(standin_refuse_start, (unsigned code), refuse_start = code)

/* Force on the hand, in the axes of HDAPI; position, velocity; frames, motors, updates of the calibration, scheduled,
   how often it was opened; forces of all arms that were dropped by a stop. */
HOOK(standin_look, (int k, double *out), {
    for (int i = 0; i < 3; i++) {
        out[i] = arms[k].motors && !arms[k].unplugged ? arms[k].force[i] : 0.0;
        out[3 + i] = arms[k].position[i];
        out[6 + i] = arms[k].velocity[i];
    }
    out[9] = (double)arms[k].frames;
    out[10] = arms[k].motors;
    out[11] = arms[k].updates;
    out[12] = scheduled;
    out[13] = arms[k].openings;
    out[14] = dropped;
})

/* The newest durations of a callback in ns; returns how many. */
long standin_durations(int64_t *out, long n)
{
    pthread_mutex_lock(&lock);
    long have = n_durations < KEPT ? n_durations : KEPT;
    have = have < n ? have : n;
    memcpy(out, durations, (size_t)have * sizeof *out);
    n_durations = 0;
    pthread_mutex_unlock(&lock);
    return have;
}
