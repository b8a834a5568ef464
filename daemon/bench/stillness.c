/* Notes when a core stood still: sleeps on a grid above everything else there, and prints from when until when it was
 * not woken although it was time, by CLOCK_MONOTONIC. Until SIGTERM. stillness.py compiles and starts it: PROGRAM CORE */

#define _GNU_SOURCE
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#define PERIOD_NS 2000000L
#define LEAST_S 0.001
#define PRIORITY 90

static volatile sig_atomic_t running = 1;

static void stop(int number)
{
    (void)number;
    running = 0;
}

static double seconds(struct timespec time) { return time.tv_sec + 1e-9 * time.tv_nsec; }

int main(int argc, char **argv)
{
    if (argc != 2)
        return EXIT_FAILURE;
    const struct sched_param priority = {.sched_priority = PRIORITY};
    const struct sigaction action = {.sa_handler = stop};
    cpu_set_t core;
    CPU_ZERO(&core);
    CPU_SET(atoi(argv[1]), &core);
    sigaction(SIGTERM, &action, NULL);
    const pid_t parent = getppid();
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent)
        return EXIT_FAILURE;
    if (sched_setaffinity(0, sizeof core, &core) != 0 || sched_setscheduler(0, SCHED_FIFO, &priority) != 0) {
        perror("stillness");
        return EXIT_FAILURE;
    }
    mlockall(MCL_CURRENT | MCL_FUTURE);
    struct timespec due, now;
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (running) {
        due.tv_nsec += PERIOD_NS;
        if (due.tv_nsec >= 1000000000L) {
            due.tv_nsec -= 1000000000L;
            due.tv_sec++;
        }
        while (running && clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) != 0)
            ;
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (seconds(now) - seconds(due) >= LEAST_S) {
            printf("%.6f %.6f\n", seconds(due), seconds(now));
            due = now;
        }
    }
    return EXIT_SUCCESS; /* which writes what was printed */
}
