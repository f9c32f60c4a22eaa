/* A planner in C: follows its route at the limit and brakes for what is ahead. docs/isolation.md says the protocol.
 *
 *   cc -O2 -o follow_route follow_route.c -lm && tsbench run --planner exe:./follow_route --split dev --isolate
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

enum { HELLO = 2, CONTEXT = 4, ROUTE = 5, OBSERVATION = 10, DONE = 11, CONTROL = 12 };
enum { MOST_FIELDS = 32 };

static int line = 3; /* or the socket that TSBENCH_LINE names, in a container */

/* A field of a message: so many items, or bytes of text. */
typedef struct { uint32_t count; const unsigned char *data; } Field;

static Field field[MOST_FIELDS];
static double *points, *limits; /* of the route: x y, and arc length with the limit from there on */
static uint32_t n_points, n_limits;

static size_t filled(size_t size) { return (size + 15) / 16 * 16; }

static void read_all(void *to, size_t size) {
    for (size_t done = 0; done < size;) {
        ssize_t now = read(line, (char *)to + done, size - done);
        if (now <= 0) exit(0); /* the referee has closed the line */
        done += (size_t)now;
    }
}

static void send_message(uint32_t kind, const void *body, uint32_t size) {
    char out[512];
    memcpy(out, &size, 4), memcpy(out + 4, &kind, 4), memcpy(out + 8, body, size);
    for (size_t done = 0; done < size + 8;) {
        ssize_t now = write(line, out + done, size + 8 - done);
        if (now <= 0) exit(0);
        done += (size_t)now;
    }
}

/* A body from malloc and its fields lie at multiples of 16 bytes: numbers are read where they are. */
static const double *numbers(Field f) { return (const double *)f.data; }

/* Splits a body into its fields; items: for each of them the bytes of one item, 1 for text. */
static void split(const unsigned char *body, const char *items) {
    const unsigned char *data = body + filled(4 * strlen(items));
    for (int k = 0; items[k]; k++) {
        memcpy(&field[k].count, body + 4 * k, 4);
        field[k].data = data;
        data += filled((size_t)field[k].count * (size_t)(items[k] - '0'));
    }
}

static double *copy(Field f) {
    double *own = malloc(8 * (size_t)f.count);
    memcpy(own, f.data, 8 * (size_t)f.count);
    return own;
}

static void command(double acceleration, double steering) {
    /* numbers, intent, has_plan, plan */
    struct { uint32_t counts[4]; double numbers[2]; unsigned char has_plan[16]; } body =
        {{2, 0, 1, 0}, {acceleration, steering}, {0}};
    send_message(CONTROL, &body, sizeof body);
}

static void act(const unsigned char *body) {
    /* numbers, ego_lane, history, poses, speeds, lanes, indicators, distances */
    split(body, "84888418");
    const double *now = numbers(field[0]), *poses = numbers(field[3]);
    double x = now[2], y = now[3], heading = now[4], speed = now[5], s = now[11], left = now[13];
    double ahead = 4.0 + 0.8 * speed, along = 0.0, wanted = 8.0, gap = 1e9;
    double tx = points[2 * n_points - 2], ty = points[2 * n_points - 1];
    for (uint32_t k = 1; k < n_points; k++) { /* the point of the route that far ahead */
        double dx = points[2 * k] - points[2 * k - 2], dy = points[2 * k + 1] - points[2 * k - 1], d = hypot(dx, dy);
        if (along + d >= s + ahead) {
            double t = (s + ahead - along) / d;
            tx = points[2 * k - 2] + t * dx, ty = points[2 * k - 1] + t * dy;
            break;
        }
        along += d;
    }
    for (uint32_t k = 0; k < n_limits; k++)
        if (limits[2 * k] <= s) wanted = limits[2 * k + 1];
    for (uint32_t k = 0; k < field[3].count / 3; k++) { /* road users in the lane ahead: x y heading */
        double dx = poses[3 * k] - x, dy = poses[3 * k + 1] - y;
        double u = dx * cos(heading) + dy * sin(heading), v = -dx * sin(heading) + dy * cos(heading);
        if (u > 0.0 && fabs(v) < 1.8 && u - 5.0 < gap) gap = u - 5.0;
    }
    double bearing = atan2(ty - y, tx - x) - heading;
    if (left < gap) wanted = fmin(wanted, 6.0);
    wanted = fmin(wanted, sqrt(fmax(2.0 * 2.0 * (gap - 2.0), 0.0)));
    command(fmax(fmin(wanted - speed, 1.5), -4.0), atan2(2.0 * 2.469 * sin(bearing), ahead));
}

static void connect_line(const char *place) {
    struct sockaddr_un there = {.sun_family = AF_UNIX};
    strncpy(there.sun_path, place, sizeof there.sun_path - 1);
    line = socket(AF_UNIX, SOCK_STREAM, 0);
    if (connect(line, (struct sockaddr *)&there, sizeof there) != 0) exit(1);
}

int main(void) {
    if (getenv("TSBENCH_LINE")) connect_line(getenv("TSBENCH_LINE"));
    const char facts[] = "{\"protocol\": 3, \"name\": \"follow_route\", \"sign_access\": false}";
    unsigned char hello[16 + 96] = {sizeof facts - 1}; /* its count, and zeros behind both */
    uint32_t head[2];
    memcpy(hello + 16, facts, sizeof facts - 1);
    send_message(HELLO, hello, (uint32_t)(16 + filled(sizeof facts - 1)));
    for (;;) {
        read_all(head, sizeof head);
        unsigned char *body = malloc(head[0] + 1);
        read_all(body, head[0]);
        if (head[1] == CONTEXT) send_message(DONE, "", 0);
        if (head[1] == OBSERVATION) act(body);
        if (head[1] == ROUTE) { /* edges, points, piece_lanes, pieces, limits, destination */
            split(body, "184888");
            free(points), free(limits);
            points = copy(field[1]), n_points = field[1].count / 2;
            limits = copy(field[4]), n_limits = field[4].count / 2;
        }
        free(body);
    }
}
