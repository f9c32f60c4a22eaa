/* A planner in C: follows its route at the limit and brakes for what is ahead. docs/isolation.md says the protocol.
 *
 *   cc -O2 -o follow_route follow_route.c -lm && tsbench run --planner exe:./follow_route --split dev --isolate
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { HELLO = 2, CONTEXT = 4, ROUTE = 5, OBSERVATION = 7, DONE = 8, CONTROL = 9 };
enum { LINE = 3, MOST_FIELDS = 32 };

/* A field of a message: so many items, or bytes of text, unaligned. */
typedef struct { uint32_t count; const unsigned char *data; } Field;

static Field field[MOST_FIELDS];
static double *points, *limits; /* of the route: x y, and arc length with the limit from there on */
static uint32_t n_points, n_limits;

static void read_all(void *to, size_t size) {
    for (size_t done = 0; done < size;) {
        ssize_t now = read(LINE, (char *)to + done, size - done);
        if (now <= 0) exit(0); /* the referee has closed the line */
        done += (size_t)now;
    }
}

static void send_message(uint32_t kind, const void *body, uint32_t size) {
    char out[512];
    memcpy(out, &size, 4), memcpy(out + 4, &kind, 4), memcpy(out + 8, body, size);
    for (size_t done = 0; done < size + 8;) {
        ssize_t now = write(LINE, out + done, size + 8 - done);
        if (now <= 0) exit(0);
        done += (size_t)now;
    }
}

static double number(Field f, uint32_t k) {
    double value;
    memcpy(&value, f.data + 8 * (size_t)k, 8);
    return value;
}

/* Splits a body into its fields; items: for each of them the bytes of one item, 1 for text. */
static void split(const unsigned char *body, const char *items) {
    for (int k = 0; items[k]; k++) {
        memcpy(&field[k].count, body, 4);
        field[k].data = body + 4;
        body += 4 + (size_t)field[k].count * (size_t)(items[k] - '0');
    }
}

static double *copy(Field f) {
    double *own = malloc(8 * (size_t)f.count);
    memcpy(own, f.data, 8 * (size_t)f.count);
    return own;
}

static void command(double acceleration, double steering) {
    struct { uint32_t count; unsigned char numbers[16]; uint32_t intent, flags, has_plan, plan; } body =
        {.count = 2, .intent = 0, .flags = 1, .has_plan = 0, .plan = 0};
    memcpy(body.numbers, &acceleration, 8), memcpy(body.numbers + 8, &steering, 8);
    send_message(CONTROL, &body, sizeof body);
}

static void act(const unsigned char *body) {
    /* clock, ego, ego_lane, history, route, actor_words, actors, sign_names, sign_lanes, signs, ... */
    split(body, "884884814818");
    double x = number(field[1], 0), y = number(field[1], 1), heading = number(field[1], 2), speed = number(field[1], 3);
    double s = number(field[4], 0), ahead = 4.0 + 0.8 * speed, along = 0.0, wanted = 8.0, gap = 1e9;
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
    for (uint32_t k = 0; k < field[6].count / 6; k++) { /* road users in the lane ahead: x y heading speed length width */
        double dx = number(field[6], 6 * k) - x, dy = number(field[6], 6 * k + 1) - y;
        double u = dx * cos(heading) + dy * sin(heading), v = -dx * sin(heading) + dy * cos(heading);
        if (u > 0.0 && fabs(v) < 1.8 && u - 5.0 < gap) gap = u - 5.0;
    }
    double bearing = atan2(ty - y, tx - x) - heading, left = number(field[4], 2);
    if (left < gap) wanted = fmin(wanted, 6.0);
    wanted = fmin(wanted, sqrt(fmax(2.0 * 2.0 * (gap - 2.0), 0.0)));
    command(fmax(fmin(wanted - speed, 1.5), -4.0), atan2(2.0 * 2.469 * sin(bearing), ahead));
}

int main(void) {
    const char facts[] = "{\"protocol\": 1, \"name\": \"follow_route\", \"sign_access\": false}";
    unsigned char hello[4 + sizeof facts - 1];
    uint32_t head[2] = {sizeof facts - 1, 0};
    memcpy(hello, head, 4), memcpy(hello + 4, facts, sizeof facts - 1);
    send_message(HELLO, hello, sizeof hello);
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
