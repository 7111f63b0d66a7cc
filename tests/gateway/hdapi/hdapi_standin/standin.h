/* A stand-in for OpenHaptics' libHD.so: the functions of HDAPI that Trocar calls, three arms behind them, and hooks with
   which a test makes them fail. Written from the public documentation of the interface. */
#ifndef STANDIN_H
#define STANDIN_H

#include <stdint.h>

enum { ARMS = 3, ERRORS = 64, FIRST_HANDLE = 7 };

/* HDErrorInfo */
typedef struct {
    unsigned code;
    int internal;
    unsigned handle;
} ErrorInfo;

typedef unsigned (*Callback)(void *);

typedef struct {
    /* mechanics, in m, m/s and N, axes as HDAPI has them: right, up, toward the user */
    double position[3], velocity[3], force[3], hand[3];
    double gimbal[3], temperature, dry; /* dry: Coulomb friction, N */
    /* what the device is */
    double max_force;
    int style, dof, lacks; /* lacks: a parameter that it does not know */
    /* what it is doing */
    int open, in_frame, framed, motors, calibration, in_inkwell, updates, buttons;
    /* what a test has spoiled */
    int unplugged, not_a_number, wrong_frames;
    double wrong[3]; /* what is added to the position in so many frames, m */
    unsigned inject, inject_every;
    /* of this opening, and how many there were */
    unsigned handle, openings;
    long frames;
} StandInArm;

extern StandInArm arms[ARMS];

void move_arm(StandInArm *arm, double dt);
void raise_error(unsigned code, unsigned handle);

#endif
