/* The same host in C, with the codec of protocol/c: a focus 150 mm above a board of 16 x 16. */
#define _DEFAULT_SOURCE
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <termios.h>
#include <unistd.h>

#include "haptogram_codec.h"

static int port;
static uint16_t session = 0x5eed;

static void send_frame(uint8_t type, uint8_t flags, uint16_t seq, const uint8_t *payload, size_t length)
{
    uint8_t line[HG_FRAME_BOUND(HG_HEADER_BYTES + 258)];
    struct hg_header header = {type, flags, seq, 0, type == HG_TYPE_HELLO ? 0 : session};
    size_t size = hg_build_frame(line, sizeof line, &header, payload, length);

    if (write(port, line, size) != (ssize_t)size)
        perror("write");
}

static int wait_for(uint8_t type)
{
    static struct hg_parser parser;
    struct hg_frame frame;
    uint8_t byte;
    size_t taken;

    while (read(port, &byte, 1) == 1) /* events come unasked: what was not asked for is skipped */
        if (hg_parse(&parser, &byte, 1, &taken, &frame) == HG_PARSED_FRAME && frame.header.type == type)
            return 1;
    fprintf(stderr, "no answer of type 0x%02x\n", type);
    return 0;
}

int main(int argc, char **argv)
{
    struct termios raw;
    uint8_t hello[8], phases[256];
    struct hg_hello asked = {HG_VERSION_MAJOR, HG_VERSION_MINOR, session, 0};

    if (argc != 2 || (port = open(argv[1], O_RDWR | O_NOCTTY)) < 0 || tcgetattr(port, &raw))
        return 2;
    cfmakeraw(&raw);
    raw.c_cc[VMIN] = 0;
    raw.c_cc[VTIME] = 20; /* two seconds */
    tcsetattr(port, TCSANOW, &raw);
    hg_hello_write(hello, &asked);
    send_frame(HG_TYPE_HELLO, 0, 0, hello, sizeof hello);
    if (!wait_for(HG_TYPE_HELLO_REPLY))
        return 1;
    send_frame(HG_TYPE_ARM, 0, 1, NULL, 0);
    if (!wait_for(HG_TYPE_ARM_REPLY))
        return 1;
    for (int n = 0; n < 256; n++) {
        double x = (n / 16 - 7.5) * 10, y = (n % 16 - 7.5) * 10;
        phases[n] = (uint8_t)lround(-256 * sqrt(x * x + y * y + 150 * 150) / 8.60);
    }
    for (uint16_t frame = 0; frame < 100; frame++) {
        send_frame(HG_TYPE_PHASES, HG_FLAG_IMMEDIATE, (uint16_t)(0xfff0 + frame), phases, sizeof phases);
        usleep(5000);
    }
    send_frame(HG_TYPE_MUTE, 0, 2, NULL, 0);
    if (!wait_for(HG_TYPE_MUTE_REPLY))
        return 1;
    puts("100 frames sent, the board is muted");
    return 0;
}
