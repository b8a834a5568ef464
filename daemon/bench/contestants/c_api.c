/* A plain C program on libcmavsdk, all of its threads under SCHED_FIFO where that is permitted: the newest ODOMETRY is
 * echoed at 100 Hz, on an absolute grid of CLOCK_MONOTONIC. c_api.py compiles and starts it: PROGRAM PORT SECONDS WARM_UP.
 * The wheel of mavsdk brings no headers; the declarations are those of its Python plugins. */

#include <math.h>
#include <sched.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <time.h>

#define PERIOD_NS 10000000L
#define PRIORITY 40
#define COMPANION_COMPUTER 2
#define CONNECTED 0 /* ConnectionResult */
#define STARTED 1   /* OffboardResult */

typedef struct { float roll_deg_s, pitch_deg_s, yaw_deg_s, thrust; } attitude_rate_t;
typedef struct { float x, y, z; } vector_t;
typedef struct { float w, x, y, z; uint64_t stamp_us; } quaternion_t;
typedef struct { float *matrix; size_t size; } covariance_t;
typedef struct {
    uint64_t time_us;
    int frame_id, child_frame_id;
    vector_t position_m;
    quaternion_t q;
    vector_t velocity_m_s, rates_rad_s;
    covariance_t pose_covariance, velocity_covariance;
} odometry_t;

void *mavsdk_configuration_create_with_component_type(int type);
void *mavsdk_create(void *configuration);
int mavsdk_add_any_connection(void *mavsdk, const char *url);
void *mavsdk_first_autopilot(void *mavsdk, double timeout_s);
void *mavsdk_telemetry_create(void *system);
void *mavsdk_telemetry_subscribe_odometry(void *telemetry, void (*callback)(odometry_t, void *), void *user_data);
void mavsdk_telemetry_odometry_destroy(odometry_t *odometry);
void *mavsdk_offboard_create(void *system);
int mavsdk_offboard_set_attitude_rate(void *offboard, attitude_rate_t setpoint);
int mavsdk_offboard_start(void *offboard);

static _Atomic float newest_x_m = NAN;

static void take(odometry_t odometry, void *user_data)
{
    (void)user_data;
    atomic_store(&newest_x_m, odometry.position_m.x);
    mavsdk_telemetry_odometry_destroy(&odometry);
}

static attitude_rate_t setpoint(float thrust) { return (attitude_rate_t){0.0f, 0.0f, 0.0f, thrust}; }

static double now_s(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

static double cpu_s(void)
{
    struct rusage used;
    getrusage(RUSAGE_SELF, &used);
    return used.ru_utime.tv_sec + used.ru_stime.tv_sec + 1e-6 * (used.ru_utime.tv_usec + used.ru_stime.tv_usec);
}

static double peak_mb(void)
{
    char line[256];
    double kilobytes = 0.0;
    FILE *status = fopen("/proc/self/status", "r");
    while (status && fgets(line, sizeof line, status))
        sscanf(line, "VmHWM: %lf", &kilobytes);
    if (status)
        fclose(status);
    return kilobytes / 1024.0;
}

static void sleep_until_next(struct timespec *due)
{
    due->tv_nsec += PERIOD_NS;
    if (due->tv_nsec >= 1000000000L) {
        due->tv_nsec -= 1000000000L;
        due->tv_sec++;
    }
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, due, NULL) != 0)
        ;
}

static int failed(const char *what)
{
    printf("{\"error\": \"%s\"}\n", what);
    return EXIT_FAILURE;
}

int main(int argc, char **argv)
{
    if (argc != 4)
        return failed("usage: PROGRAM PORT SECONDS WARM_UP");
    const double seconds = atof(argv[2]), warm_up_s = atof(argv[3]);
    char url[64];
    snprintf(url, sizeof url, "udpin://127.0.0.1:%s", argv[1]);
    const struct sched_param priority = {.sched_priority = PRIORITY};
    const int fifo = sched_setscheduler(0, SCHED_FIFO, &priority) == 0; /* threads that are made later inherit it */

    void *mavsdk = mavsdk_create(mavsdk_configuration_create_with_component_type(COMPANION_COMPUTER));
    if (mavsdk_add_any_connection(mavsdk, url) != CONNECTED)
        return failed("no connection");
    void *system = mavsdk_first_autopilot(mavsdk, 10.0);
    if (!system)
        return failed("no autopilot");
    void *telemetry = mavsdk_telemetry_create(system), *offboard = mavsdk_offboard_create(system);
    mavsdk_telemetry_subscribe_odometry(telemetry, take, NULL);
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (isnan(atomic_load(&newest_x_m)))
        sleep_until_next(&due);
    mavsdk_offboard_set_attitude_rate(offboard, setpoint(0.5f));
    if (mavsdk_offboard_start(offboard) != STARTED)
        return failed("offboard refused");

    clock_gettime(CLOCK_MONOTONIC, &due);
    const double warm_s = now_s() + warm_up_s;
    double from_s = 0.0, before_cpu_s = 0.0;
    while (now_s() < warm_s + seconds) {
        if (from_s == 0.0 && now_s() >= warm_s) {
            from_s = now_s();
            before_cpu_s = cpu_s();
        }
        const float number = roundf(1e6f * atomic_load(&newest_x_m)); /* as thrust_of() of common.py */
        mavsdk_offboard_set_attitude_rate(offboard, setpoint(0.3f + 1e-4f * number));
        sleep_until_next(&due);
    }
    printf("\n{\"from_s\": %.9f, \"to_s\": %.9f, \"cpu_s\": %.6f, \"rss_mb\": %.1f, \"fifo\": %d}\n", from_s, now_s(),
           cpu_s() - before_cpu_s, peak_mb(), fifo);
    fflush(stdout);
    _Exit(EXIT_SUCCESS); /* what MAVSDK holds is the system's to take back */
}
