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

static int line = 3; /* or the socket that TSBENCH_LINE names, in a container */

static double *points, *limit_s, *limits; /* of the route: x y, arc lengths, and the limit from each on */
static uint32_t n_points, n_limits;

static void read_all(void *to, size_t size) {
    for (size_t done = 0; done < size;) {
        ssize_t now = read(line, (char *)to + done, size - done);
        if (now <= 0) exit(0); /* the referee has closed the line */
        done += (size_t)now;
    }
}

static void send_message(const void *body, uint32_t size) {
    char out[512];
    memcpy(out, &size, 4), memcpy(out + 4, body, size);
    for (size_t done = 0; done < size + 4;) {
        ssize_t now = write(line, out + done, size + 4 - done);
        if (now <= 0) exit(0);
        done += (size_t)now;
    }
}

/* MessagePack: a value is a byte that says what it is, a big-endian number, and in maps, arrays, texts and bytes so
 * many of what they hold. */
typedef const unsigned char *Value;

static uint64_t big_endian(Value at, int bytes) {
    uint64_t found = 0;
    for (int k = 0; k < bytes; k++) found = found << 8 | at[k];
    return found;
}

/* Where what a value holds begins; count: values in it; size: its bytes where it holds none. */
static Value open_value(Value at, uint64_t *count, uint64_t *size) {
    int kind = *at++, bytes = 0;
    *count = *size = 0;
    if (kind >= 0x80 && kind <= 0x9f) *count = (uint64_t)(kind & 15) << (kind < 0x90); /* a map's keys, too */
    else if (kind >= 0xa0 && kind <= 0xbf) *size = kind & 31;
    else if (kind >= 0xc4 && kind <= 0xc6) *size = big_endian(at, bytes = 1 << (kind - 0xc4));
    else if (kind >= 0xca && kind <= 0xcb) *size = 4 << (kind - 0xca);
    else if (kind >= 0xcc && kind <= 0xd3) *size = 1 << (kind & 3);
    else if (kind >= 0xd9 && kind <= 0xdb) *size = big_endian(at, bytes = 1 << (kind - 0xd9));
    else if (kind >= 0xdc && kind <= 0xdf) *count = big_endian(at, bytes = 2 << (kind & 1)) << (kind > 0xdd);
    return at + bytes;
}

static Value after(Value at) {
    uint64_t count, size;
    for (at = open_value(at, &count, &size) + size; count; count--) at = after(at);
    return at;
}

static int is_text(Value at, const char *text) {
    uint64_t count, size;
    Value data = open_value(at, &count, &size);
    return size == strlen(text) && memcmp(data, text, size) == 0;
}

/* The value of a map's key. */
static Value get(Value map, const char *key) {
    uint64_t count, size;
    for (Value at = open_value(map, &count, &size); count; count -= 2, at = after(after(at)))
        if (is_text(at, key)) return after(at);
    exit(1);
}

static double number(Value at) {
    double found;
    uint64_t bits = big_endian(at + 1, 8);
    memcpy(&found, &bits, 8);
    return *at == 0xcb ? found : *at < 0x80 ? *at : NAN; /* a whole one may be short */
}

/* An array's numbers, which are [dtype, shape, bytes]: a copy, and how many there are. */
static double *numbers(Value array, uint32_t *n) {
    uint64_t count, size;
    Value data = open_value(after(after(array + 1)), &count, &size);
    double *own = malloc(size + 8);
    memcpy(own, data, size), *n = (uint32_t)(size / 8);
    return own;
}

static void put(unsigned char *at, double value) {
    uint64_t bits;
    memcpy(&bits, &value, 8);
    for (int k = 0; k < 8; k++) at[k] = (unsigned char)(bits >> (56 - 8 * k));
}

static void command(double acceleration, double steering) {
    unsigned char body[] = "\x83\xa4kind\xa7" "control\xac" "acceleration\xcb" "........\xa8steering\xcb" "........";
    put(body + 28, acceleration), put(body + 46, steering);
    send_message(body, sizeof body - 1);
}

static void new_path(Value path) {
    free(points), free(limit_s), free(limits);
    points = numbers(get(path, "line"), &n_points), n_points /= 2;
    limit_s = numbers(get(path, "limit_s"), &n_limits);
    limits = numbers(get(path, "limit"), &n_limits);
}

static void act(Value body) {
    if (*get(body, "path") != 0xc0) new_path(get(body, "path")); /* nil: the same as before */
    Value ego = get(body, "ego"), route = get(body, "route") + 1; /* s, d, remaining */
    double x = number(get(ego, "x")), y = number(get(ego, "y")), heading = number(get(ego, "heading"));
    double speed = number(get(ego, "speed")), s = number(route), left = number(after(after(route)));
    uint32_t n_poses;
    double *poses = numbers(get(get(body, "actors"), "pose"), &n_poses); /* x y heading */
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
        if (limit_s[k] <= s) wanted = limits[k];
    for (uint32_t k = 0; k < n_poses / 3; k++) { /* road users in the lane ahead */
        double dx = poses[3 * k] - x, dy = poses[3 * k + 1] - y;
        double u = dx * cos(heading) + dy * sin(heading), v = -dx * sin(heading) + dy * cos(heading);
        if (u > 0.0 && fabs(v) < 1.8 && u - 5.0 < gap) gap = u - 5.0;
    }
    free(poses);
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
    const char hello[] =
        "\x84\xa4kind\xa5hello\xa8protocol\x05\xa4name\xac" "follow_route\xabsign_access\xc2";
    send_message(hello, sizeof hello - 1);
    for (;;) {
        uint32_t size;
        read_all(&size, sizeof size);
        unsigned char *body = malloc(size);
        read_all(body, size);
        if (is_text(get(body, "kind"), "context")) send_message("\x81\xa4kind\xa4" "done", 11);
        if (is_text(get(body, "kind"), "observation")) act(body);
        free(body);
    }
}
