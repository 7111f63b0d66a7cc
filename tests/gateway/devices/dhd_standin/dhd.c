/* A stand-in of Force Dimension's DHD by its public header: devices that tests move, and what can go wrong with them. */
#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <string.h>
#include <time.h>

enum { DEVICES = 2, STATES = 16, FORCES = 7, LOG = 1 << 16 };
enum { POWER, CONNECTED, STARTED, RESET, IDLE, FORCE, ERROR = 9 };

struct device {
  bool there, open, on, has_gripper;
  double place[3], frame[9], angle, force[FORCES];
  int status[STATES], serial, openings, gravity;
  unsigned buttons;
  const char *name;
};

static struct device devices[DEVICES];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int failing, hang_ms, count = 1, logged;
static double log_n[LOG][4]; /* of the arm, and of its gripper */
static __thread const char *error = "no error";

/* A device bears a force while it is there, has power, and its motors are on: the library's call and its own button. */
static bool bears(const struct device *d) {
  return d->there && !failing && d->on && d->status[POWER] && d->status[FORCE];
}

static void log_force(signed char id) {
  if (id != 0 || logged >= LOG) return;
  for (int k = 0; k < 4; k++) log_n[logged][k] = bears(&devices[0]) ? devices[0].force[k < 3 ? k : FORCES - 1] : 0.0;
  logged++;
}

static struct device *find(signed char id) {
  struct device *d = id >= 0 && id < DEVICES ? &devices[(int)id] : NULL;
  if (hang_ms > 0) {
    struct timespec t = {hang_ms / 1000, (hang_ms % 1000) * 1000000L};
    nanosleep(&t, NULL);
  }
  if (d == NULL || !d->open) {
    error = "device is not open";
    return NULL;
  }
  if (!d->there || failing) {
    error = "communication error";
    return NULL;
  }
  return d;
}

int dhdErrorGetLast(void) { return 2; }
const char *dhdErrorGetLastStr(void) { return error; }
int dhdGetDeviceCount(void) { return count; }

int dhdOpenID(signed char id) {
  if (id < 0 || id >= count || !devices[(int)id].there || devices[(int)id].open) {
    error = "no device found";
    return -1;
  }
  devices[(int)id].open = true;
  devices[(int)id].openings++;
  return id;
}

int dhdClose(signed char id) {
  struct device *d = &devices[(int)id];
  d->open = d->on = false;
  memset(d->force, 0, sizeof d->force);
  return 0;
}

int dhdGetSerialNumber(unsigned short *out, signed char id) {
  *out = (unsigned short)devices[(int)id].serial;
  return 0;
}

const char *dhdGetSystemName(signed char id) { return devices[(int)id].name; }

int dhdEnableForce(unsigned char on, signed char id) {
  struct device *d = find(id);
  if (d == NULL) return -1;
  d->on = on != 0;
  d->status[FORCE] = d->on;
  return 0;
}

int dhdSetGravityCompensation(int on, signed char id) {
  struct device *d = find(id);
  if (d == NULL) return -1;
  d->gravity = on;
  return 0;
}

int dhdGetStatus(int *out, signed char id) {
  struct device *d = find(id);
  if (d == NULL) return -1;
  memcpy(out, d->status, sizeof d->status);
  return 0;
}

bool dhdHasWrist(signed char id) { return devices[(int)id].has_gripper; }
bool dhdHasGripper(signed char id) { return devices[(int)id].has_gripper; }
bool dhdHasActiveGripper(signed char id) { return devices[(int)id].has_gripper; }
unsigned dhdGetButtonMask(signed char id) { return devices[(int)id].buttons; }

int dhdGetPosition(double *x, double *y, double *z, signed char id) {
  struct device *d = find(id);
  if (d == NULL) return -1;
  pthread_mutex_lock(&lock);
  *x = d->place[0], *y = d->place[1], *z = d->place[2];
  pthread_mutex_unlock(&lock);
  return 0;
}

int dhdGetOrientationFrame(double out[9], signed char id) {
  struct device *d = find(id);
  if (d == NULL) return -1;
  memcpy(out, d->frame, sizeof d->frame);
  return 0;
}

int dhdGetGripperAngleRad(double *out, signed char id) {
  struct device *d = find(id);
  if (d == NULL) return -1;
  *out = d->angle;
  return 0;
}

int dhdSetForceAndTorqueAndGripperForce(double x, double y, double z, double a, double b, double c, double g,
                                        signed char id) {
  struct device *d = find(id);
  double force[FORCES] = {x, y, z, a, b, c, g};
  pthread_mutex_lock(&lock);
  if (d == NULL && id >= 0 && id < DEVICES) memset(force, 0, sizeof force); /* one that is away forgets */
  if (id >= 0 && id < DEVICES) memcpy(devices[(int)id].force, force, sizeof force);
  log_force(id);
  pthread_mutex_unlock(&lock);
  return d == NULL ? -1 : 0;
}

/* Hooks of the tests. */
void standin_reset(int n) {
  memset(devices, 0, sizeof devices);
  failing = hang_ms = logged = 0;
  count = n;
  for (int k = 0; k < DEVICES; k++) {
    struct device *d = &devices[k];
    d->there = d->has_gripper = true;
    d->name = "omega.7";
    d->serial = 100 + k;
    d->angle = 0.3;
    d->frame[0] = d->frame[4] = d->frame[8] = 1.0;
    d->status[POWER] = d->status[CONNECTED] = d->status[STARTED] = d->status[RESET] = 1;
  }
}

void standin_place(int k, double x, double y, double z) {
  double place[3] = {x, y, z};
  pthread_mutex_lock(&lock);
  memcpy(devices[k].place, place, sizeof place);
  pthread_mutex_unlock(&lock);
}

void standin_turn(int k, double angle) {
  double frame[9] = {1, 0, 0, 0, cos(angle), -sin(angle), 0, sin(angle), cos(angle)};
  memcpy(devices[k].frame, frame, sizeof frame);
}

void standin_open(int k, double angle) { devices[k].angle = angle; }
void standin_state(int k, int state, int value) { devices[k].status[state] = value; }
void standin_plug(int k, int there) { devices[k].there = there; }
void standin_name(int k, const char *name) { devices[k].name = name; }
void standin_gripper(int k, int has) { devices[k].has_gripper = has; }
void standin_press(int k, unsigned mask) { devices[k].buttons = mask; }
void standin_fail(int on) { failing = on; }
void standin_hang(int ms) { hang_ms = ms; }
int standin_gravity(int k) { return devices[k].gravity; }

double standin_force(int k, int axis) {
  pthread_mutex_lock(&lock);
  double force = bears(&devices[k]) ? devices[k].force[axis] : 0.0;
  pthread_mutex_unlock(&lock);
  return force;
}

int standin_log(double *out, int most) {
  int n = logged < most ? logged : most;
  memcpy(out, log_n, (size_t)n * sizeof log_n[0]);
  return n;
}
