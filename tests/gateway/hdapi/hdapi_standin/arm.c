/* An arm as a mass in a hand: enough to see whether force goes where it should, and whether energy comes out. */
#include <math.h>

#include "standin.h"

static const double MASS = 0.075, HAND_STIFFNESS = 300.0, HAND_DAMPING = 5.0, FRICTION = 0.1;
enum { SUBSTEPS = 20 }; /* one would act as if the force came half a tick earlier */
static const double HEATING = 2e-3, COOLING = 0.05; /* share of the limit per N^2 s, per s */

static void step(StandInArm *arm, double dt)
{
    double force2 = 0.0, speed2 = 0.0;
    for (int i = 0; i < 3; i++) {
        double applied = arm->motors && !arm->unplugged ? arm->force[i] : 0.0;
        double total = applied + HAND_STIFFNESS * (arm->hand[i] - arm->position[i])
                       - (HAND_DAMPING + FRICTION) * arm->velocity[i];
        arm->velocity[i] += dt * total / MASS;
        speed2 += arm->velocity[i] * arm->velocity[i];
        force2 += applied * applied;
    }
    double stops = dt * arm->dry / MASS, speed = sqrt(speed2);
    for (int i = 0; i < 3; i++) {
        arm->velocity[i] *= speed > stops ? 1.0 - stops / speed : 0.0;
        arm->position[i] += dt * arm->velocity[i];
    }
    arm->temperature += dt * (HEATING * force2 - COOLING * arm->temperature);
}

void move_arm(StandInArm *arm, double dt)
{
    for (int k = 0; k < SUBSTEPS; k++)
        step(arm, dt / SUBSTEPS);
}
