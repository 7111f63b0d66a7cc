/* The interface: devices, frames, errors, calibration. Calls that HDAPI forbids raise the error that it documents. */
#define _GNU_SOURCE
#include "standin.h"

#include <math.h>
#include <stdatomic.h>
#include <stddef.h>
#include <string.h>
#include <time.h>

enum {
    INVALID_ENUM = 0x0100, INVALID_OPERATION = 0x0102, BAD_HANDLE = 0x0104,
    EXCEEDED_MAX_FORCE = 0x0201, EXCEEDED_MAX_VELOCITY = 0x0203,
    DEVICE_FAULT = 0x0300, ALREADY_INITIATED = 0x0301, COMM_ERROR = 0x0302,
    ILLEGAL_BEGIN = 0x0400, ILLEGAL_END = 0x0401, FRAME_ERROR = 0x0402,
};
enum { CALIBRATION_OK = 0x5000, NEEDS_UPDATE = 0x5001, NEEDS_MANUAL_INPUT = 0x5002 };
enum { ENCODER_RESET = 1, AUTO = 2, INKWELL = 4 };
static const double MAX_VELOCITY = 1.2;
static const char *const NAMES[ARMS] = {"Default Device", "Left", "Right"};

StandInArm arms[ARMS];
static ErrorInfo errors[ERRORS];
static int n_errors;
static unsigned current; /* a handle */
unsigned refuse_init, complain_init;
atomic_int init_ms; /* how long a device takes to be opened: until then, or until it is less */
int running; /* the scheduler: devices are added while it stands */

void raise_error(unsigned code, unsigned handle)
{
    if (n_errors < ERRORS)
        errors[n_errors++] = (ErrorInfo){code, 0, handle};
}

ErrorInfo hdGetError(void)
{
    return n_errors > 0 ? errors[--n_errors] : (ErrorInfo){0, 0, 0};
}

static StandInArm *at(unsigned handle)
{
    for (int k = 0; k < ARMS; k++)
        if (arms[k].open && arms[k].handle == handle)
            return &arms[k];
    raise_error(BAD_HANDLE, handle);
    return NULL;
}

static StandInArm *the_current(void)
{
    return at(current);
}

unsigned hdInitDevice(const char *name)
{
    int k = 0;
    while (name != NULL && k < ARMS && strcmp(name, NAMES[k]) != 0)
        k++;
    int is_there = k < ARMS && !arms[k].unplugged;
    unsigned failure = refuse_init ? refuse_init
                       : running ? INVALID_OPERATION
                       : !is_there ? DEVICE_FAULT
                       : arms[k].open ? ALREADY_INITIATED : 0;
    for (int waited_ms = 0; waited_ms < atomic_load(&init_ms); waited_ms++)
        nanosleep(&(struct timespec){0, 1000000L}, NULL);
    if (failure) {
        raise_error(failure, 0xFFFFFFFFu);
        return 0xFFFFFFFFu;
    }
    StandInArm *arm = &arms[k];
    arm->open = 1;
    arm->motors = arm->in_frame = arm->framed = 0;
    arm->calibration = arm->style == INKWELL && !arm->in_inkwell ? NEEDS_MANUAL_INPUT : NEEDS_UPDATE;
    memset(arm->force, 0, sizeof arm->force);
    arm->handle = FIRST_HANDLE + k + ARMS * arm->openings++; /* never that of one that is dead */
    if (complain_init)
        raise_error(complain_init, arm->handle);
    return current = arm->handle;
}

void hdDisableDevice(unsigned handle)
{
    StandInArm *arm = at(handle);
    if (arm)
        arm->open = arm->motors = 0;
}

void hdMakeCurrentDevice(unsigned handle)
{
    if (at(handle))
        current = handle;
}

void hdBeginFrame(unsigned handle)
{
    StandInArm *arm = at(handle);
    if (!arm)
        return;
    if (arm->in_frame || arm->framed)
        raise_error(ILLEGAL_BEGIN, handle);
    if (arm->unplugged)
        raise_error(COMM_ERROR, handle);
    arm->in_frame = 1;
    current = handle;
}

static void limit_force(StandInArm *arm, unsigned handle)
{
    const double *f = arm->force, *v = arm->velocity;
    unsigned refusal = 0;
    if (sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]) > arm->max_force)
        refusal = EXCEEDED_MAX_FORCE;
    if (sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) > MAX_VELOCITY)
        refusal = EXCEEDED_MAX_VELOCITY;
    if (!refusal)
        return;
    raise_error(refusal, handle);
    memset(arm->force, 0, sizeof arm->force);
}

void hdEndFrame(unsigned handle)
{
    StandInArm *arm = at(handle);
    if (!arm)
        return;
    if (!arm->in_frame)
        raise_error(ILLEGAL_END, handle);
    arm->in_frame = 0;
    arm->framed = 1;
    arm->frames++;
    limit_force(arm, handle);
    if (arm->inject)
        raise_error(arm->inject, handle);
    if (arm->inject_every)
        raise_error(arm->inject_every, handle);
    arm->inject = 0;
}

void hdEnable(unsigned capability)
{
    StandInArm *arm = the_current();
    if (arm && capability == 0x4000)
        arm->motors = 1;
}

void hdDisable(unsigned capability)
{
    StandInArm *arm = the_current();
    if (arm && capability == 0x4000)
        arm->motors = 0;
}

/* The current device, if it knows `parameter` and this is the moment to ask. */
static StandInArm *asked(unsigned parameter, int needs_frame)
{
    StandInArm *arm = the_current();
    if (!arm)
        return NULL;
    unsigned handle = current;
    if (arm->lacks == (int)parameter) {
        raise_error(INVALID_ENUM, handle);
        return NULL;
    }
    if (needs_frame && !arm->in_frame)
        raise_error(FRAME_ERROR, handle);
    return arm;
}

void hdGetDoublev(unsigned parameter, double *out)
{
    StandInArm *arm = asked(parameter, parameter >= 0x2050 && parameter < 0x2200);
    if (!arm)
        return;
    switch (parameter) {
    case 0x2050:
        for (int i = 0; i < 3; i++)
            out[i] = arm->not_a_number & 1 ? NAN : 1e3 * (arm->position[i] + (arm->wrong_frames > 0 ? arm->wrong[i] : 0.0));
        arm->wrong_frames -= arm->wrong_frames > 0;
        break;
    case 0x2150:
        for (int i = 0; i < 3; i++)
            out[i] = arm->not_a_number & 2 ? NAN : arm->gimbal[i];
        break;
    case 0x2603: *out = arm->max_force; break;
    case 0x2605:
        for (int i = 0; i < arm->dof; i++)
            out[i] = arm->not_a_number & 2 ? NAN : i == 1 ? arm->temperature : 0.5 * arm->temperature;
        break;
    default: raise_error(INVALID_ENUM, current);
    }
}

void hdGetIntegerv(unsigned parameter, int *out)
{
    StandInArm *arm = asked(parameter, parameter == 0x2000);
    if (!arm)
        return;
    switch (parameter) {
    case 0x2000: *out = arm->buttons; break;
    case 0x2553: *out = arm->dof; break;
    case 0x2555: *out = arm->style; break;
    default: raise_error(INVALID_ENUM, current);
    }
}

void hdSetDoublev(unsigned parameter, const double *value)
{
    StandInArm *arm = asked(parameter, 1);
    if (arm && parameter == 0x2700)
        memcpy(arm->force, value, sizeof arm->force);
}

const char *hdGetString(unsigned parameter)
{
    return parameter == 0x2501 ? "Stand-in" : parameter == 0x2504 ? "0001" : "";
}

unsigned hdCheckCalibration(void)
{
    StandInArm *arm = the_current();
    if (!arm)
        return NEEDS_MANUAL_INPUT;
    if (arm->calibration == NEEDS_MANUAL_INPUT && arm->in_inkwell)
        arm->calibration = NEEDS_UPDATE;
    return (unsigned)arm->calibration;
}

void hdUpdateCalibration(unsigned style)
{
    StandInArm *arm = the_current();
    if (!arm)
        return;
    arm->updates++;
    if (arm->style == (int)style && arm->calibration == NEEDS_UPDATE)
        arm->calibration = CALIBRATION_OK;
}
