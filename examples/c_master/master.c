/* A foreign master in plain C: drives the cards of konkuk1 over SocketCAN, without a CANopen library.
 *
 *     cc -std=c11 -O2 -Wall -Wextra -Werror -o master master.c
 *     canarm emulator --clock wall -i socketcan -c vcan0       (or --clock sync)
 *     ./master vcan0 2
 *
 * Arguments: network interface, seconds of robot time (2 unless given). It moves joint 2 to 40 degrees and holds joint 3.
 * Exit status: 0 joint 2 has arrived within 5 degrees; 1 it has not, or the bus or a card failed; 2 wrong arguments.
 * The cards tell whether they run in lockstep (object 0x2000), and the program does as they do.
 *
 * The same as a Makefile:
 *     CFLAGS = -std=c11 -O2 -Wall -Wextra -Werror
 *     master: master.c
 *             $(CC) $(CFLAGS) -o $@ $<
 */
#define _GNU_SOURCE /* ppoll */
#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { DAC = 0x12, LATCH = 0x13, ADC = 0x14, MASTER = 1, JOINTS = 2 };
enum { NMT = 0x000, SYNC = 0x080, TIME = 0x100, SDO_ANSWER = 0x580, SDO_REQUEST = 0x600, HEARTBEAT = 0x700 };
enum { ADC_INPUTS = 0x294, DAC_OUTPUTS = 0x312, LATCH_OUTPUTS = 0x213 }; /* TPDO2, RPDO2, RPDO1 of the EDS files */
enum { START = 1, STOP = 2, PRE_OPERATIONAL = 0x80, RESET = 0x81 };
enum { OK = 0, FAILED = 1, WRONG_USAGE = 2 };

static const int64_t SECOND_NS = 1000000000, CYCLE_NS = 2500000, ANSWER_NS = 10000000000;
static const unsigned HEARTBEAT_MS = 100, HEARTBEAT_CYCLES = 8; /* watched for 100 ms, sent every 20 ms */
static const double PI = 3.14159265358979323846;
static const double GOAL_DEG[JOINTS] = {40.0, 0.0}, TOLERANCE_DEG = 5.0;
static const double STIFFNESS_A_RAD[JOINTS] = {12.0, 5.0}, DAMPING_A_S_RAD[JOINTS] = {0.8, 0.3};

static int bus;
static volatile sig_atomic_t is_interrupted;

static void on_signal(int number)
{
    (void)number;
    is_interrupted = 1;
}

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * SECOND_NS + now.tv_nsec;
}

static int send_frame(canid_t id, const uint8_t *data, size_t size)
{
    struct can_frame frame = {.can_id = id, .can_dlc = (uint8_t)size};
    if (size > 0)
        memcpy(frame.data, data, size);
    if (write(bus, &frame, sizeof frame) == (ssize_t)sizeof frame)
        return OK;
    perror("master: send");
    return FAILED;
}

/* 1: a frame came; 0: none before the deadline; -1: the bus is lost. */
static int receive_frame(struct can_frame *frame, int64_t deadline_ns)
{
    for (;;) {
        int64_t left_ns = deadline_ns - now_ns();
        if (left_ns < 0)
            left_ns = 0;
        struct timespec left = {.tv_sec = left_ns / SECOND_NS, .tv_nsec = left_ns % SECOND_NS};
        struct pollfd events = {.fd = bus, .events = POLLIN};
        int ready = ppoll(&events, 1, &left, NULL);
        if (ready == 0)
            return 0;
        if (ready > 0 && read(bus, frame, sizeof *frame) == (ssize_t)sizeof *frame)
            return 1;
        if (ready > 0 || errno != EINTR) {
            perror("master: receive");
            return -1;
        }
    }
}

static int await_frame(canid_t id, struct can_frame *frame)
{
    int64_t deadline_ns = now_ns() + ANSWER_NS;
    int came;
    while ((came = receive_frame(frame, deadline_ns)) > 0)
        if (frame->can_id == id)
            return OK;
    if (came == 0)
        fprintf(stderr, "master: no frame 0x%03X within 10 s; is an emulator with konkuk1 on this bus?\n", id);
    return FAILED;
}

static int nmt(uint8_t command, uint8_t node)
{
    return send_frame(NMT, (const uint8_t[]){command, node}, 2);
}

/* One expedited SDO transfer: request and answer have eight bytes, command 0x80 is an abort. */
static int sdo(uint8_t node, const uint8_t *request, struct can_frame *answer)
{
    if (send_frame(SDO_REQUEST + node, request, 8) != OK || await_frame(SDO_ANSWER + node, answer) != OK)
        return FAILED;
    if (answer->can_dlc == 8 && answer->data[0] != 0x80)
        return OK;
    fprintf(stderr, "master: node 0x%02X aborts SDO 0x%02X%02X:%02X\n", node, request[2], request[1], request[3]);
    return FAILED;
}

/* Boot-up, then 0x1016:1 = master << 16 | milliseconds: the card switches its outputs off when we fall silent. */
static int prepare(uint8_t node)
{
    struct can_frame frame;
    const uint8_t watch[8] = {0x23, 0x16, 0x10, 1, HEARTBEAT_MS, 0, MASTER, 0};
    if (nmt(RESET, node) != OK || await_frame(HEARTBEAT + node, &frame) != OK)
        return FAILED;
    return sdo(node, watch, &frame);
}

/* Current in A to DAC code (left-adjusted in 16 bits: code << 7) and direction bits: 01 clockwise, 10 the other way. */
static int put_outputs(const double *current_a)
{
    uint8_t outputs[8] = {0}, directions = 0; /* the card's RPDO has four channels, two are wired */
    for (int joint = 0; joint < JOINTS; joint++) {
        double magnitude = current_a[joint] < 0 ? -current_a[joint] : current_a[joint];
        int code = (int)(magnitude * 255 / 1.5 + 0.5);
        int value = (code > 255 ? 255 : code) << 7;
        outputs[2 * joint] = (uint8_t)value;
        outputs[2 * joint + 1] = (uint8_t)(value >> 8);
        directions |= (uint8_t)((current_a[joint] < 0 ? 1 : 2) << 2 * joint);
    }
    if (send_frame(DAC_OUTPUTS, outputs, sizeof outputs) != OK)
        return FAILED;
    return send_frame(LATCH_OUTPUTS, &directions, 1);
}

/* Inputs of a cycle: until TIME in lockstep, until `deadline_ns` on the wall clock. */
static int get_inputs(int is_lockstep, int64_t deadline_ns, int *codes)
{
    struct can_frame frame;
    int came;
    while ((came = receive_frame(&frame, is_lockstep ? now_ns() + ANSWER_NS : deadline_ns)) > 0) {
        if (frame.can_id == ADC_INPUTS && frame.can_dlc == 8)
            for (int channel = 0; channel < 2 * JOINTS; channel++)
                codes[channel] = (frame.data[2 * channel] | frame.data[2 * channel + 1] << 8) >> 7;
        else if ((frame.can_id & ~0x7Fu) == SYNC && frame.can_dlc == 8 && (frame.data[0] || frame.data[1])) {
            fprintf(stderr, "master: EMCY 0x%02X%02X of node 0x%02X\n", frame.data[1], frame.data[0],
                    frame.can_id & 0x7F);
            return FAILED;
        } else if (frame.can_id == TIME && is_lockstep)
            return OK;
    }
    if (came == 0 && is_lockstep)
        fprintf(stderr, "master: no TIME within 10 s of SYNC\n");
    return came < 0 || is_lockstep ? FAILED : OK;
}

/* The cycles of the run; joint 2 in degrees at its end. */
static int drive(int is_lockstep, long cycles, double *joint2_deg)
{
    const uint8_t operational = 5;
    int codes[2 * JOINTS] = {128, 128, 128, 128}; /* two potentiometers, two tachometers */
    int64_t next_ns = now_ns();
    for (long tick = 0; tick < cycles && !is_interrupted; tick++) {
        if (tick % HEARTBEAT_CYCLES == 0 && send_frame(HEARTBEAT + MASTER, &operational, 1) != OK)
            return FAILED;
        next_ns += CYCLE_NS;
        if (next_ns < now_ns())
            next_ns = now_ns(); /* the machine stalled: go on from here instead of catching up */
        if (send_frame(SYNC, NULL, 0) != OK || get_inputs(is_lockstep, next_ns, codes) != OK)
            return FAILED;
        double current_a[JOINTS];
        for (int joint = 0; joint < JOINTS; joint++) {
            double angle_deg = (codes[joint] - 127.5) * 270.0 / 255;
            double speed_rad_s = (codes[JOINTS + joint] - 127.5) * 2.5 / 127.5;
            current_a[joint] = STIFFNESS_A_RAD[joint] * (GOAL_DEG[joint] - angle_deg) * PI / 180
                               - DAMPING_A_S_RAD[joint] * speed_rad_s;
        }
        *joint2_deg = (codes[0] - 127.5) * 270.0 / 255;
        if (put_outputs(current_a) != OK)
            return FAILED;
    }
    return is_interrupted ? FAILED : OK;
}

static int open_bus(const char *interface)
{
    struct ifreq request = {0};
    struct sockaddr_can address = {.can_family = AF_CAN};
    bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    if (bus < 0) {
        perror("master: SocketCAN");
        return FAILED;
    }
    strncpy(request.ifr_name, interface, IFNAMSIZ - 1);
    if (ioctl(bus, SIOCGIFINDEX, &request) < 0) {
        fprintf(stderr, "master: %s: %s\n", interface, strerror(errno));
        return FAILED;
    }
    address.can_ifindex = request.ifr_ifindex;
    if (bind(bus, (struct sockaddr *)&address, sizeof address) < 0) {
        fprintf(stderr, "master: %s: %s\n", interface, strerror(errno));
        return FAILED;
    }
    return OK;
}

int main(int count, char **words)
{
    const uint8_t read_clock[8] = {0x40, 0x00, 0x20, 0};
    const uint8_t cards[] = {DAC, LATCH, ADC};
    struct can_frame answer;
    char *rest = "";
    double seconds = count > 2 ? strtod(words[2], &rest) : 2.0, joint2_deg = 0.0;
    if (count < 2 || count > 3 || *rest != '\0' || !(seconds > 0.0 && seconds < 1e5)) {
        fprintf(stderr, "master: write: master INTERFACE [SECONDS], such as: master vcan0 2\n");
        return WRONG_USAGE;
    }
    signal(SIGINT, on_signal);
    signal(SIGTERM, on_signal);
    if (open_bus(words[1]) != OK)
        return FAILED;
    for (size_t card = 0; card < sizeof cards; card++)
        if (prepare(cards[card]) != OK)
            return FAILED;
    if (sdo(ADC, read_clock, &answer) != OK || nmt(START, 0) != OK)
        return FAILED;
    int status = drive(answer.data[4] == 1, (long)(seconds * SECOND_NS / CYCLE_NS + 0.5), &joint2_deg);
    /* Safe in every case: in STOPPED the outputs take their error values, current 0. */
    if (nmt(STOP, 0) != OK || nmt(PRE_OPERATIONAL, 0) != OK || status != OK)
        return FAILED;
    printf("joint 2 is at %.1f deg\n", joint2_deg);
    return joint2_deg > GOAL_DEG[0] - TOLERANCE_DEG && joint2_deg < GOAL_DEG[0] + TOLERANCE_DEG ? OK : FAILED;
}
