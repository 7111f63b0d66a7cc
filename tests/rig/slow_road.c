/* A road between network namespaces: IP packets from tunnel to tunnel, late and lost as asked. The kernels' own TCP
 * deals with it, as it would with a network. (netem does the same, where a kernel has it.)
 *
 *     slow_road NAMESPACE...      the k-th has the address 10.77.0.k, its tunnel is called "road"
 *
 * Each line of the standard input sets it anew: delay and jitter one way in us, and the share of packets lost. Jitter
 * is uniform, up to so much more; packets never overtake each other. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

enum { HOSTS = 4, SLOTS = 1 << 14, LONGEST = 1600 };
struct packet { long long due_ns; int length; unsigned char bytes[LONGEST]; };
/* One queue an end: what is on its way to there, in order. */
static struct packet *queue[HOSTS];
static unsigned first[HOSTS], last[HOSTS];

static long long now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static int tunnel(const char *space) {
    char path[256];
    struct ifreq request = {.ifr_flags = IFF_TUN | IFF_NO_PI};
    snprintf(path, sizeof path, "/var/run/netns/%s", space);
    int netns = open(path, O_RDONLY), entered = netns < 0 ? -1 : setns(netns, CLONE_NEWNET);
    int tun = open("/dev/net/tun", O_RDWR | O_NONBLOCK); /* of the namespace in which it is opened */
    strcpy(request.ifr_name, "road");
    if (entered || tun < 0 || ioctl(tun, TUNSETIFF, &request)) {
        perror(space);
        exit(1);
    }
    close(netns);
    return tun;
}

int main(int count, char **names) {
    struct pollfd ends[HOSTS + 1] = {{.fd = 0, .events = POLLIN}};
    long long delay_us = 0, jitter_us = 0;
    double loss = 0.0;
    int hosts = count - 1;
    if (hosts > HOSTS) return 1;
    srand48(1);
    for (int k = 0; k < hosts; k++) {
        ends[k + 1] = (struct pollfd){.fd = tunnel(names[k + 1]), .events = POLLIN};
        queue[k] = malloc(SLOTS * sizeof **queue);
    }
    puts("open");
    fflush(stdout);
    for (;;) {
        long long next_ns = now_ns() + 1000000000LL, left_ns;
        for (int k = 0; k < hosts; k++)
            if (first[k] != last[k] && queue[k][first[k] % SLOTS].due_ns < next_ns)
                next_ns = queue[k][first[k] % SLOTS].due_ns;
        left_ns = next_ns - now_ns();
        if (left_ns < 0) left_ns = 0;
        struct timespec wait = {left_ns / 1000000000LL, left_ns % 1000000000LL};
        ppoll(ends, hosts + 1, &wait, NULL);
        if (ends[0].revents) {
            char line[128];
            ssize_t length = read(0, line, sizeof line - 1);
            if (length <= 0) return 0;
            line[length] = 0;
            sscanf(line, "%lld %lld %lf", &delay_us, &jitter_us, &loss);
        }
        for (int k = 0; k < hosts; k++) {
            struct packet packet;
            while ((packet.length = read(ends[k + 1].fd, packet.bytes, LONGEST)) >= 20) {
                int to = packet.bytes[19] - 1; /* last byte of the IPv4 destination */
                if (packet.bytes[0] >> 4 != 4 || to < 0 || to >= hosts || drand48() < loss || last[to] - first[to] == SLOTS)
                    continue;
                packet.due_ns = now_ns() + 1000 * (delay_us + (long long)(drand48() * jitter_us));
                if (first[to] != last[to] && queue[to][(last[to] - 1) % SLOTS].due_ns > packet.due_ns)
                    packet.due_ns = queue[to][(last[to] - 1) % SLOTS].due_ns;
                queue[to][last[to]++ % SLOTS] = packet;
            }
        }
        for (int k = 0; k < hosts; k++)
            for (; first[k] != last[k] && queue[k][first[k] % SLOTS].due_ns <= now_ns(); first[k]++)
                if (write(ends[k + 1].fd, queue[k][first[k] % SLOTS].bytes, queue[k][first[k] % SLOTS].length) < 0) continue;
    }
}
